//! Placement as the dissertation does it (figure 3-4): images at the viewpoints of an adaptive grid.
//!
//! Viewpoints are taken from a queue. Where some view of one holds more than the budget, the most expensive view gets an
//! image, which serves the neighbouring views as long as they stay within the budget, until none exceeds it. Where no
//! image lies outside the star-shape, the grid is subdivided around the viewpoint. Frames use the closest viewpoint in
//! their reverse frustum, and its image for their yaw.

use super::directions::{Directions, Upright};
use super::frustum::Field;
use super::grid::{Grid, MOST_LEVEL, Place};
use super::optimise::{Goal, Solution, View, Weights, annealing, paper, windows};
use super::star::{Gazes, Star, lattice};
use crate::bounds::Bounds;
use crate::control::Control;
use crate::error::Error;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Which search finds the subset of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Optimiser {
    Paper {
        lookahead: usize,
        keep: paper::Keep,
    },
    Annealing {
        steps: usize,
        seed: u64,
    },
    /// Starts from what the dissertation's search finds, so that it is never worse.
    Windows {
        lookahead: usize,
        gap: f64,
        most: usize,
    },
}

impl Optimiser {
    /// The subset of a view that becomes an image, if any leaves few enough primitives.
    pub fn solve(self, view: &View) -> Option<Solution> {
        match self {
            Self::Paper { lookahead, keep } => paper::search(view, lookahead, keep),
            Self::Annealing { steps, seed } => annealing::anneal(view, steps, seed),
            Self::Windows { lookahead, gap, most } => {
                let start = paper::search(view, lookahead, paper::Keep::Best)?;
                windows::search(view, gap, most, Some(start))
            }
        }
    }
}

/// How large star-shapes are taken to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Spheres of two spacings at even levels and three at odd ones; eyes may break both.
    Paper,
    /// What branch and bound proves for the viewpoints that are there, the domain, and each range of yaws.
    Certified,
}

/// When the grid is subdivided around a viewpoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subdivide {
    /// Where some view has more than the budget within the star-shape (section 3.6.1), or no image outside it.
    Count,
    /// Where the optimiser finds no image outside the star-shape (figure 3-4).
    Solve,
}

/// What is asked for.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    pub budget: u64,
    /// P_opt: what an image's own view may have left.
    pub target: u64,
    pub upright: Upright,
    /// The field of the images' views: that of the frames, or wider.
    pub field: Field,
    pub resolution: [usize; 3],
    pub weights: Weights,
    pub optimiser: Optimiser,
    pub shape: Shape,
    pub subdivide: Subdivide,
    /// More viewpoints than this are an error.
    pub most_viewpoints: usize,
}

/// An image of a viewpoint, and the views it serves.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    pub viewpoint: u32,
    /// Top-left, top-right, bottom-right, bottom-left as seen from the viewpoint.
    pub corners: [DVec3; 4],
    pub forward: DVec3,
    /// The gazes served: from this yaw, counter-clockwise, so many radians.
    pub yaw: f64,
    pub width: f64,
    /// Primitives left in the image's own view, in that view altogether, and the value of the solution.
    pub remaining: u64,
    pub total: u64,
    pub value: f64,
    /// How much more any subset could be worth; infinite if unknown.
    pub gap: f64,
}

/// A grid with its images.
#[derive(Debug, Clone)]
pub struct Placed {
    pub viewpoints: Vec<DVec3>,
    pub levels: Vec<u32>,
    /// The radius of each star-shape.
    pub radii: Vec<f64>,
    pub images: Vec<Image>,
}

/// Into how many ranges of yaw certified star-shapes are divided: where no eye of the domain looks that way, no image is
/// needed. More ranges say so more often, and take longer.
const RANGES: usize = 12;

/// Star-shapes of a placement are known to this much, and no more parts are searched for one range.
const STAR_GAP: f64 = 0.03;
const STAR_PARTS: usize = 1 << 10;

/// Viewpoints farther away than so many spacings are not asked whether they take eyes over: then star-shapes are a
/// little larger than they must be.
const STAR_REACH: f64 = 6.0;

/// Images are this much larger and nearer than the outlines that they cover, relatively: some roundings.
const ROUNDING: f64 = 1e-9;

/// Places images for the cells of a scene that fills `domain`, where the eyes are.
///
/// # Errors
/// [`Error::Invalid`] where no subdivision helps, with what would; [`Error::Interrupted`].
pub fn place(
    cells: &[Bounds],
    counts: &[u32],
    domain: Bounds,
    settings: &Settings,
    control: &Control,
) -> Result<Placed, Error> {
    let mut grid = initial(domain, settings, control)?;
    let mut queue: Vec<Place> = grid.levels().keys().copied().collect();
    let mut done: BTreeMap<Place, Solved> = BTreeMap::new();
    while !queue.is_empty() {
        let solved: Vec<(Place, Outcome)> = queue
            .par_iter()
            .map(|&place| {
                let job = Job { cells, counts, domain, settings, grid: &grid, place };
                let outcome = job.solve(control)?;
                control.step(1)?;
                Ok((place, outcome))
            })
            .collect::<Result<_, Error>>()?;
        let mut failed = Vec::new();
        for (place, outcome) in solved {
            match outcome {
                Outcome::Solved(solved) => {
                    done.insert(place, solved);
                }
                Outcome::Failed(needed) => {
                    if grid.levels()[&place] >= MOST_LEVEL {
                        let at = grid.position(place).to_array();
                        return Err(Error::Invalid(format!(
                            "budget is {}: at the viewpoint {at:?}, {needed} primitives lie before any image, however \
                             near together viewpoints are (1/64 of the first spacing); a budget above {needed} would do \
                             there",
                            settings.budget
                        )));
                    }
                    failed.push(place);
                }
            }
        }
        queue = grid.subdivide(&failed);
        if grid.levels().len() > settings.most_viewpoints {
            return Err(Error::Invalid(format!(
                "budget is {}: the grid grew to {} viewpoints, max_viewpoints is {}; take a larger budget or a finer \
                 leaf_depth",
                settings.budget,
                grid.levels().len(),
                settings.most_viewpoints
            )));
        }
    }
    let mut placed = Placed { viewpoints: vec![], levels: vec![], radii: vec![], images: vec![] };
    for (&place, &level) in grid.levels() {
        let solved = done.remove(&place).expect("every viewpoint of the grid was in the queue");
        let viewpoint = placed.viewpoints.len() as u32;
        placed.images.extend(solved.images.into_iter().map(|image| Image { viewpoint, ..image }));
        placed.viewpoints.push(grid.position(place));
        placed.levels.push(level);
        placed.radii.push(solved.radius);
    }
    Ok(placed)
}

/// The first grid, with its margin: the dissertation's two rings, or all viewpoints that an eye may be nearest to.
fn initial(domain: Bounds, settings: &Settings, control: &Control) -> Result<Grid, Error> {
    match settings.shape {
        Shape::Paper => Ok(Grid::new(domain, settings.resolution, 2.0, true)),
        Shape::Certified => {
            // Every viewpoint within the covering radius, half a cube's diagonal, of a point that far behind an eye.
            let half = settings.field.tan_x.min(settings.field.tan_y).atan();
            let others = lattice(false, [0; 3], 3.0_f64.sqrt() * (1.0 + 1.0 / half.sin()));
            let (field, upright, gazes) = (settings.field, settings.upright, Gazes::Yaw(0.0, TAU));
            let star = Star { others: &others, field, upright, gazes, domain: None };
            let radius = star.radius(STAR_GAP, STAR_PARTS, control)?.high;
            Ok(Grid::new(domain, settings.resolution, radius, false))
        }
    }
}

/// What became of a viewpoint.
enum Outcome {
    Solved(Solved),
    /// So many primitives lie before any image of some view.
    Failed(u64),
}

struct Solved {
    images: Vec<Image>,
    radius: f64,
}

/// One viewpoint to find images for.
struct Job<'a> {
    cells: &'a [Bounds],
    counts: &'a [u32],
    domain: Bounds,
    settings: &'a Settings,
    grid: &'a Grid,
    place: Place,
}

impl Job<'_> {
    fn solve(&self, control: &Control) -> Result<Outcome, Error> {
        let Settings { budget, target, upright, field, weights, .. } = *self.settings;
        let viewpoint = self.grid.position(self.place);
        let directions = Directions::new(self.cells, self.counts, viewpoint, upright, field);
        let all = directions.peaks(|c| self.counts[c as usize].into());
        if all.iter().all(|&n| n <= budget) {
            return Ok(Outcome::Solved(Solved { images: vec![], radius: 0.0 }));
        }
        let radii = self.radii(control)?;
        let radius = radii.iter().copied().fold(0.0, f64::max);
        let range = |yaw: f64| ((yaw / TAU * radii.len() as f64) as usize).min(radii.len() - 1);
        // What gazes of a sector need: the greatest radius of the ranges that it touches; zero if no eye has such a gaze.
        let star: Vec<f64> = (0..directions.sectors())
            .map(|i| {
                let (from, width) = directions.sector(i);
                let ranges = (width / TAU * radii.len() as f64).ceil() as usize;
                (0..=ranges).map(|k| radii[(range(from) + k) % radii.len()]).fold(0.0, f64::max)
            })
            .collect();
        if self.settings.subdivide == Subdivide::Count {
            let within = |c: u32| {
                let b = &self.cells[c as usize];
                let near = viewpoint.clamp(b.low, b.high).distance(viewpoint) < radius;
                if near { self.counts[c as usize].into() } else { 0 }
            };
            let most = directions.peaks(within).into_iter().zip(&star).filter(|s| *s.1 > 0.0);
            let most = most.map(|s| s.0).max().unwrap_or(0);
            if most > budget {
                return Ok(Outcome::Failed(most));
            }
        }
        let size = self.domain.size();
        let screen = 2.0 * field.tan_x.max(field.tan_y);
        let mut served: Vec<bool> = all.iter().zip(&star).map(|(&n, &r)| n <= budget || r == 0.0).collect();
        let mut images = Vec::new();
        while let Some(next) =
            (0..all.len()).filter(|&i| !served[i]).max_by_key(|&i| (all[i], usize::MAX - i))
        {
            let yaw = directions.middle(next);
            let frustum = upright.frustum(viewpoint, yaw, field);
            let view = |target| {
                let goal = Goal { target, nearest: star[next], screen, axis: size.max_element(), weights };
                View::new(self.cells, self.counts, &frustum, goal)
            };
            let mut aim = target;
            let (solution, window, near, hidden) = loop {
                let Some(solution) = self.settings.optimiser.solve(&view(aim)) else {
                    return Ok(Outcome::Failed(view(aim).least()));
                };
                let window = grown(&solution);
                let near = solution.near * (1.0 - ROUNDING);
                let culled: Vec<bool> =
                    self.cells.par_iter().map(|c| frustum.covers(c, &window, near)).collect();
                let left = |c: u32| if culled[c as usize] { 0 } else { self.counts[c as usize].into() };
                let hidden = directions.peaks(left);
                if hidden[next] <= budget {
                    break (solution, window, near, hidden);
                }
                // The ends of the sector see more than its middle, for which the image was made.
                let Some(less) = aim.checked_sub(hidden[next] - budget) else {
                    return Ok(Outcome::Failed(hidden[next]));
                };
                aim = less;
            };
            let serves = |i: usize| hidden[i] <= budget && (star[i] <= near || i == next);
            let (first, sectors) = run(next, all.len(), serves);
            for i in 0..sectors {
                served[(first + i) % all.len()] = true;
            }
            let width = (0..sectors).map(|i| directions.sector((first + i) % all.len()).1).sum();
            let [left, right, bottom, top] = window;
            let corner =
                |x: f64, y: f64| viewpoint + (frustum.forward + frustum.right * x + frustum.up * y) * near;
            images.push(Image {
                viewpoint: 0,
                corners: [corner(left, top), corner(right, top), corner(right, bottom), corner(left, bottom)],
                forward: frustum.forward,
                yaw: directions.sector(first).0,
                width: if sectors == all.len() { TAU } else { width },
                remaining: solution.remaining,
                total: directions.counts[next],
                value: solution.value,
                gap: solution.bound - solution.value,
            });
        }
        Ok(Outcome::Solved(Solved { images, radius }))
    }

    /// The radius of the star-shape by ranges of yaw.
    fn radii(&self, control: &Control) -> Result<Vec<f64>, Error> {
        let level = self.grid.levels()[&self.place];
        let spacing = self.grid.spacing(level);
        if self.settings.shape == Shape::Paper {
            return Ok(vec![if level.is_multiple_of(2) { 2.0 } else { 3.0 } * spacing]);
        }
        let viewpoint = self.grid.position(self.place);
        let others = self.grid.within(self.place, STAR_REACH * spacing);
        let domain = Some(Bounds { low: self.domain.low - viewpoint, high: self.domain.high - viewpoint });
        let step = TAU / RANGES as f64;
        (0..RANGES)
            .map(|k| {
                let gazes = Gazes::Yaw(k as f64 * step, (k + 1) as f64 * step);
                let (field, upright) = (self.settings.field, self.settings.upright);
                let star = Star { others: &others, field, upright, gazes, domain };
                Ok(star.radius(STAR_GAP, STAR_PARTS, control)?.high)
            })
            .collect()
    }
}

/// The outline of a solution, with room for rounding.
fn grown(solution: &Solution) -> [f64; 4] {
    let [left, right, bottom, top] = solution.window;
    let room = ROUNDING * (1.0 + left.abs().max(right.abs()).max(bottom.abs()).max(top.abs()));
    [left - room, right + room, bottom - room, top + room]
}

/// The run of neighbours, in a circle of `count`, that `serves` holds for: where it begins and how long it is.
fn run(start: usize, count: usize, serves: impl Fn(usize) -> bool) -> (usize, usize) {
    let after = (1..count).take_while(|&k| serves((start + k) % count)).count();
    let before = (1..count - after).take_while(|&k| serves((start + count - k) % count)).count();
    ((start + count - before) % count, before + 1 + after)
}

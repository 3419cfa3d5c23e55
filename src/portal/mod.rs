//! What an eye in a building sees through its doors (1998 dissertation, section 6.2.1).
//!
//! Cells, the rooms, open into each other and outdoors through portals, flat convex polygons. The view from an eye's cell
//! is followed through every sequence of portals, each time with the cone that is left of it. A ray crosses a flat portal
//! once, so no sequence has one twice, and loops of rooms end.

pub mod cone;
pub mod winding;

use crate::bounds::Bounds;
use cone::{Cone, Part};
use glam::DVec3;

/// An opening.
#[derive(Debug, Clone)]
pub struct Portal {
    /// Its convex outline.
    pub polygon: Vec<DVec3>,
    /// The places on both sides: a cell's index, or the number of cells for outdoors.
    pub places: [usize; 2],
}

impl Portal {
    /// Whether a point lies on it, up to `slack`.
    pub fn holds(&self, point: DVec3, slack: f64) -> bool {
        let normal = cone::normal_of(&self.polygon).normalize_or_zero();
        let middle = cone::middle_of(&self.polygon);
        (point - middle).dot(normal).abs() <= slack
            && cone::edges(&self.polygon)
                .all(|(a, b)| (point - a).dot(normal.cross(b - a).normalize_or_zero()) >= -slack)
    }
}

/// Faces of a cell that follow each other in the mesh, with a box around them.
#[derive(Debug, Clone)]
struct Block {
    bounds: Bounds,
    faces: Vec<u32>,
}

/// Faces in a block: few enough that most blocks are small, enough that their boxes are few.
const BLOCK: usize = 32;

/// Rooms, the openings between them, and the faces that can be seen in each.
#[derive(Debug, Clone)]
pub struct Building {
    portals: Vec<Portal>,
    /// The portals of each place, outdoors last.
    doors: Vec<Vec<usize>>,
    /// Cells in which views that come in end.
    shut: Vec<bool>,
    corners: Vec<[DVec3; 3]>,
    blocks: Vec<Vec<Block>>,
    /// The largest coordinate there is.
    extent: f64,
}

/// A portal that is shown as an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// Twice its index, plus one if it is seen from the second of its places.
    pub side: usize,
    /// The part of it that is in view.
    pub opening: Vec<DVec3>,
}

/// What a walk through all sequences of portals found.
#[derive(Debug, Clone, Default)]
pub struct Walk {
    /// Each place that is looked into, in order, once for each sequence of portals that shows more of it; and the cone
    /// that is left there.
    pub views: Vec<(usize, Cone)>,
    /// Portals at which it ended because they are images.
    pub shown: Vec<Shown>,
    /// The portals that were looked through; ascending.
    pub open: Vec<usize>,
}

/// A view that is being followed: into which place, and which of its portals is next.
struct Step {
    place: usize,
    cone: Cone,
    door: usize,
    through: Option<usize>,
}

impl Building {
    /// `faces` are those that can be seen in each place, one more than `shut` says of cells: outdoors is last.
    ///
    /// # Panics
    /// If a portal names no place, or a face isn't there: the caller has checked them.
    pub fn new(portals: Vec<Portal>, shut: Vec<bool>, corners: Vec<[DVec3; 3]>, faces: &[&[u32]]) -> Self {
        assert_eq!(faces.len(), shut.len() + 1, "a list of faces a cell, and one of outdoors");
        let mut doors = vec![vec![]; faces.len()];
        for (index, portal) in portals.iter().enumerate() {
            for place in portal.places {
                doors[place].push(index);
            }
        }
        let block = |faces: &[u32]| Block {
            bounds: Bounds::of(faces.iter().flat_map(|&face| corners[face as usize])),
            faces: faces.to_vec(),
        };
        let blocks = faces.iter().map(|faces| faces.chunks(BLOCK).map(block).collect()).collect();
        let points = corners.iter().flatten().chain(portals.iter().flat_map(|portal| &portal.polygon));
        let extent = points.fold(0.0, |most: f64, point| most.max(point.abs().max_element()));
        Self { portals, doors, shut, corners, blocks, extent }
    }

    pub fn portals(&self) -> &[Portal] {
        &self.portals
    }

    /// How many cells there are, and outdoors.
    pub fn places(&self) -> usize {
        self.doors.len()
    }

    /// Follows the view of a cone's eye from `places`, never through the portals in `crossed`.
    ///
    /// With `entered` it came into the first places through a portal, so that a cell that is shut ends it. A portal is an
    /// image if `image` says so of its side, see [`Shown`]; it is asked once a side, when the first view comes there.
    ///
    /// What was looked at through a side already isn't followed again: its rays are the same, and go on in the same way.
    /// Without that, portals that overlap double the sequences, one after the other.
    pub fn walk(
        &self,
        start: &Cone,
        places: &[usize],
        crossed: &[usize],
        entered: bool,
        mut image: impl FnMut(usize) -> bool,
    ) -> Walk {
        let slack = self.slack(start.eye);
        let mut found = Walk::default();
        let mut used = vec![false; self.portals.len()];
        for &portal in crossed {
            used[portal] = true;
        }
        let mut open = vec![false; self.portals.len()];
        let mut images = vec![None; 2 * self.portals.len()];
        let mut followed: Vec<Vec<Cone>> = vec![vec![]; 2 * self.portals.len()];
        let mut steps = vec![];
        for &place in places {
            found.views.push((place, start.clone()));
            let ends = entered && self.shut.get(place) == Some(&true);
            let door = if ends { usize::MAX } else { 0 };
            steps.push(Step { place, cone: start.clone(), door, through: None });
            while let Some(step) = steps.last_mut() {
                let Some(&portal) = self.doors[step.place].get(step.door) else {
                    if let Some(portal) = step.through {
                        used[portal] = false;
                    }
                    steps.pop();
                    continue;
                };
                step.door += 1;
                if used[portal] {
                    continue;
                }
                let second = usize::from(self.portals[portal].places[0] != step.place);
                let side = 2 * portal + second;
                let opening = step.cone.clip(&self.portals[portal].polygon);
                if opening.len() < 3 || followed[side].iter().any(|wider| wider.contains(&opening, slack)) {
                    continue;
                }
                let narrower = step.cone.through(&opening);
                followed[side].extend(narrower.clone());
                if *images[side].get_or_insert_with(|| image(side)) {
                    found.shown.push(Shown { side, opening });
                } else if let Some(cone) = narrower {
                    open[portal] = true;
                    used[portal] = true;
                    let place = self.portals[portal].places[1 - second];
                    found.views.push((place, cone.clone()));
                    let door = if self.shut.get(place) == Some(&true) { usize::MAX } else { 0 };
                    steps.push(Step { place, cone, door, through: Some(portal) });
                }
            }
        }
        found.open = (0..open.len()).filter(|&portal| open[portal]).collect();
        found
    }

    /// What any eye at a point sees through the whole of a portal, from one of its sides; see [`Shown`].
    pub fn behind(&self, eye: DVec3, side: usize) -> Walk {
        let portal = &self.portals[side / 2];
        let place = portal.places[1 - side % 2];
        Cone { eye, planes: vec![] }
            .through(&portal.polygon)
            .map_or_else(Walk::default, |cone| self.walk(&cone, &[place], &[side / 2], true, |_| false))
    }

    /// The faces that reach into some views of places; ascending.
    pub fn faces(&self, views: &[(usize, Cone)]) -> Vec<u32> {
        let mut seen = vec![false; self.corners.len()];
        for (place, cone) in views {
            let slack = self.slack(cone.eye);
            for block in &self.blocks[*place] {
                match cone.part_of(&block.bounds, slack) {
                    Part::Nothing => {}
                    Part::All => block.faces.iter().for_each(|&face| seen[face as usize] = true),
                    Part::Some => {
                        for &face in &block.faces {
                            let face = face as usize;
                            seen[face] = seen[face] || !cone.misses(&self.corners[face], slack);
                        }
                    }
                }
            }
        }
        (0..).zip(&seen).filter_map(|(face, &seen)| seen.then_some(face)).collect()
    }

    /// What rounding may have moved a plane by: what touches is kept.
    fn slack(&self, eye: DVec3) -> f64 {
        64.0 * f64::EPSILON * (self.extent + eye.abs().max_element())
    }
}

//! A second opinion on a plan, by code that shares nothing with what made it: frames looked at one by one, and the boxes
//! of a proof.
//!
//! All it knows of the scene are boxes of groups of faces. It uses no octree: what it leaves out of a part of a proof are
//! the groups that no eye of a larger part around it can see.

use crate::control::Control;
use crate::error::Error;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// A group of faces that is drawn or not as a whole.
#[derive(Debug, Clone, Copy)]
pub struct Group {
    pub center: DVec3,
    pub half: DVec3,
    pub faces: u32,
    /// From which distance to which it is drawn: where any of its box is so far away.
    pub span: [f64; 2],
}

impl Group {
    /// Whether it may be drawn for some eye of a box.
    fn is_level(&self, low: DVec3, high: DVec3, slack: f64) -> bool {
        let (least, most) = (self.center - self.half, self.center + self.half);
        let nearest = (least - high).max(low - most).max(DVec3::ZERO).length();
        let farthest = (most - low).abs().max((high - least).abs()).length();
        nearest < self.span[1] + slack && farthest >= self.span[0] - slack
    }
    fn most(&self, normal: DVec3) -> f64 {
        normal.dot(self.center) + normal.abs().dot(self.half)
    }

    fn least(&self, normal: DVec3) -> f64 {
        normal.dot(self.center) - normal.abs().dot(self.half)
    }
}

/// The planes of a quadrilateral and of the pyramid over it, towards what lies behind.
#[derive(Debug, Clone, Copy)]
pub struct Backdrop {
    pub viewpoint: DVec3,
    normals: [DVec3; 5],
    offsets: [f64; 5],
}

impl Backdrop {
    pub fn new(viewpoint: DVec3, corners: [DVec3; 4]) -> Self {
        let towards = |n: DVec3, inside: DVec3| if n.dot(inside) < 0.0 { -n } else { n }.normalize();
        let normal = (corners[2] - corners[0]).cross(corners[1] - corners[3]);
        let middle = corners.iter().sum::<DVec3>() * 0.25 - viewpoint;
        let mut normals = [towards(normal, middle); 5];
        for side in 0..4 {
            let wall = (corners[side] - viewpoint).cross(corners[(side + 1) % 4] - viewpoint);
            normals[side + 1] = towards(wall, middle);
        }
        let mut offsets = normals.map(|n| n.dot(viewpoint));
        // All corners lie in the plane; the farthest says where it is, whatever was rounded.
        offsets[0] = corners.iter().map(|&c| normals[0].dot(c)).fold(f64::NEG_INFINITY, f64::max);
        Self { viewpoint, normals, offsets }
    }

    /// Whether a group lies wholly behind, as seen from the viewpoint.
    fn hides(&self, group: &Group, slack: f64) -> bool {
        self.normals.iter().zip(self.offsets).all(|(&n, offset)| group.least(n) >= offset - slack)
    }

    /// Whether a point is strictly on the viewpoint's side.
    fn is_before(&self, point: DVec3) -> bool {
        self.normals[0].dot(point) < self.offsets[0]
    }
}

/// What both kinds of questions need.
#[derive(Debug)]
pub struct Audit {
    pub groups: Vec<Group>,
    pub backdrops: Vec<Backdrop>,
    /// Unit vectors: where yaw is zero, where it is a right angle, and up.
    pub axes: [DVec3; 3],
    pub tangents: [f64; 2],
    pub budget: u32,
    /// Lengths below this are roundings.
    pub slack: f64,
    /// Boxes of eyes, low and high, and how many faces of each group can be seen from there; none if all can.
    pub regions: Vec<([DVec3; 2], Vec<u32>)>,
}

/// What is wrong with a frame, and the distance to its viewpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    pub lost: bool,
    pub past: bool,
    pub outside: bool,
    pub distance: f64,
}

impl Audit {
    /// Looks at one frame: `drawn` says of each group whether it was drawn.
    pub fn frame(&self, eye: DVec3, gaze: DVec3, drawn: &[bool], image: Option<usize>) -> Found {
        let forward = gaze.normalize();
        let level = forward.cross(self.axes[2]);
        // Straight up or down, right is that of a yaw of zero.
        let right = if level.length() > 1e-9 { level } else { self.axes[0].cross(self.axes[2]) }.normalize();
        let up = right.cross(forward);
        let [x, y] = self.tangents;
        let sides = [right + forward * x, forward * x - right, up + forward * y, forward * y - up]
            .map(DVec3::normalize);
        let offsets = sides.map(|n| n.dot(eye));
        let backdrop = image.map(|i| &self.backdrops[i]);
        let is_seen = |g: &Group| sides.iter().zip(offsets).all(|(&n, o)| g.most(n) >= o + self.slack);
        let lost = self.groups.iter().zip(drawn).any(|(group, &drawn)| {
            !drawn
                && group.is_level(eye, eye, -self.slack)
                && is_seen(group)
                && !backdrop.is_some_and(|b| b.hides(group, self.slack))
        });
        let outside = |b: &Backdrop| sides.iter().any(|n| n.dot(eye - b.viewpoint) < -self.slack);
        Found {
            lost,
            past: backdrop.is_some_and(|b| !b.is_before(eye)),
            outside: backdrop.is_some_and(outside),
            distance: backdrop.map_or(f64::NAN, |b| b.viewpoint.distance(eye)),
        }
    }
}

/// A part of a proof, or of the domain: x, y, z, yaw and pitch, low and high.
pub type Span = [[f64; 2]; 5];

/// Ranges of angles wider than this have no hull.
const WIDEST: f64 = 1.5;

/// Parts with fewer boxes than this are not shared among threads.
const SHARED: usize = 64;

impl Audit {
    /// Checks that the spans leave nothing of `domain` out, and that each keeps the budget with the image that it names
    /// (or with none, below zero); they must be parts of repeated cuts.
    ///
    /// # Errors
    /// [`Error::Invalid`] with what fails; [`Error::Interrupted`].
    pub fn proof(
        &self,
        spans: &[Span],
        images: &[i32],
        domain: Span,
        control: &Control,
    ) -> Result<(), Error> {
        let rows = (0..spans.len() as u32).collect();
        let groups = (0..self.groups.len() as u32).collect();
        self.part(spans, images, rows, domain, groups, control)
    }

    fn part(
        &self,
        spans: &[Span],
        images: &[i32],
        mut rows: Vec<u32>,
        region: Span,
        groups: Vec<u32>,
        control: &Control,
    ) -> Result<(), Error> {
        let left_out = || Error::Invalid("the boxes leave a part of the domain out".into());
        match rows[..] {
            [] => return Err(left_out()),
            [row] => {
                let span = &spans[row as usize];
                if (0..5).any(|a| span[a][0] > region[a][0] || span[a][1] < region[a][1]) {
                    return Err(left_out());
                }
                control.step(1)?;
                return self.serves(row, images[row as usize], &region, &groups);
            }
            _ => {}
        }
        let is_narrow = region[3..].iter().all(|r| r[1] - r[0] < WIDEST);
        let groups = if is_narrow {
            let walls = Walls::new(self, &region);
            groups.into_iter().filter(|&g| !walls.miss(&self.groups[g as usize], self.slack)).collect()
        } else {
            groups
        };
        for axis in 0..5 {
            let low = |row: u32| spans[row as usize][axis][0];
            rows.sort_unstable_by(|&a, &b| low(a).total_cmp(&low(b)).then(a.cmp(&b)));
            let mut end = f64::NEG_INFINITY;
            let mut cuts = Vec::new();
            for (place, &row) in rows.iter().enumerate() {
                if place > 0 && end <= low(row) && low(row) > low(rows[0]) {
                    cuts.push(place);
                }
                end = end.max(spans[row as usize][axis][1]);
            }
            if let Some(&cut) = cuts.get(cuts.len() / 2) {
                let at = low(rows[cut]);
                let (mut below, mut above) = (region, region);
                below[axis][1] = at;
                above[axis][0] = at;
                let is_large = rows.len() >= SHARED;
                let rest = rows.split_off(cut);
                let first = || self.part(spans, images, rows, below, groups.clone(), control);
                let second = || self.part(spans, images, rest, above, groups.clone(), control);
                if is_large {
                    let (a, b) = rayon::join(first, second);
                    return a.and(b);
                }
                return first().and_then(|()| second());
            }
        }
        Err(left_out())
    }

    /// Checks a part of the proof; no group but these can be seen there.
    fn serves(&self, row: u32, image: i32, region: &Span, groups: &[u32]) -> Result<(), Error> {
        let fails = |what: String| Error::Invalid(format!("box {row}: {what}"));
        if region[3..].iter().any(|r| r[1] - r[0] >= WIDEST) {
            return Err(fails("its angles are too wide to be looked at together".into()));
        }
        let walls = Walls::new(self, region);
        let backdrop = match usize::try_from(image) {
            Err(_) => None,
            Ok(image) => {
                let none = || fails(format!("names image {image}, which is not there"));
                Some(self.backdrops.get(image).ok_or_else(none)?)
            }
        };
        if let Some(b) = backdrop {
            if walls.hulls.iter().flatten().any(|w| w.normal.dot(b.viewpoint) > w.least + self.slack) {
                let text = format!("viewpoint {image} is not in the reverse frustum of all its eyes");
                return Err(fails(text));
            }
            let n = b.normals[0];
            let farthest: f64 = (0..3).map(|a| n[a] * region[a][usize::from(n[a] > 0.0)]).sum();
            if farthest >= b.offsets[0] {
                return Err(fails(format!("an eye lies past the plane of image {image}")));
            }
        }
        let at = |end: usize| DVec3::new(region[0][end], region[1][end], region[2][end]);
        let (low, high) = (at(0), at(1));
        let holds = |[least, most]: &[DVec3; 2]| {
            low.cmpge(*least - self.slack).all() && high.cmple(*most + self.slack).all()
        };
        let counts = match &self.regions[..] {
            [] => None,
            regions => {
                let of = regions.iter().find(|r| holds(&r.0));
                Some(&of.ok_or_else(|| fails("it lies in none of the regions".into()))?.1)
            }
        };
        let mut left = 0;
        for &g in groups {
            let group = &self.groups[g as usize];
            let is_drawn = group.is_level(low, high, self.slack) && !walls.miss(group, self.slack);
            if is_drawn && !backdrop.is_some_and(|b| b.hides(group, self.slack)) {
                left += counts.map_or(group.faces, |c| c[g as usize]);
            }
        }
        if left > self.budget {
            let text = format!("{left} faces are left by image {image}, the budget is {}", self.budget);
            return Err(fails(text));
        }
        Ok(())
    }
}

/// Corners of hulls of the side planes' normals over all gazes of a region, with the least `normal . eye`.
struct Walls {
    hulls: [Vec<Wall>; 4],
}

struct Wall {
    normal: DVec3,
    least: f64,
}

impl Walls {
    fn new(audit: &Audit, region: &Span) -> Self {
        let [ahead, beside, up] = audit.axes;
        let [x, y] = audit.tangents;
        let sides = [(1.0, x, 0.0), (-1.0, x, 0.0), (0.0, y, 1.0), (0.0, y, -1.0)];
        let hulls = sides.map(|(right, forward, above)| {
            let length = (right * right + forward * forward + above * above).sqrt();
            let mut hull = Vec::new();
            for (cos_p, sin_p) in arc(region[4]) {
                for (cos_y, sin_y) in arc(region[3]) {
                    let level = ahead * cos_y + beside * sin_y;
                    let across = level.cross(up) * right;
                    let along = level * (forward * cos_p - above * sin_p);
                    let normal = (across + along + up * (forward * sin_p + above * cos_p)) / length;
                    let least = (0..3).map(|a| normal[a] * region[a][usize::from(normal[a] < 0.0)]).sum();
                    hull.push(Wall { normal, least });
                }
            }
            hull
        });
        Self { hulls }
    }

    /// Whether no eye of the region sees the group along any of its gazes.
    fn miss(&self, group: &Group, slack: f64) -> bool {
        self.hulls.iter().any(|hull| hull.iter().all(|w| group.most(w.normal) < w.least - slack))
    }
}

/// Cosines and sines of the corners of a triangle around an arc; one if it is a point.
fn arc([low, high]: [f64; 2]) -> Vec<(f64, f64)> {
    if low == high {
        return vec![(low.cos(), low.sin())];
    }
    let (middle, half) = (low.midpoint(high), (high - low) / 2.0);
    let at = |angle: f64, radius: f64| (radius * angle.cos(), radius * angle.sin());
    vec![at(low, 1.0), at(middle, 1.0 / half.cos()), at(high, 1.0)]
}

/// The whole of a domain for gazes of these pitches.
pub fn whole(low: DVec3, high: DVec3, pitch: [f64; 2]) -> Span {
    [[low.x, high.x], [low.y, high.y], [low.z, high.z], [0.0, TAU], pitch]
}

/// Looks at many frames at once; `draw` says which groups a frame draws, and its image.
///
/// # Errors
/// [`Error::Interrupted`], and those of `draw`.
pub fn frames<D>(
    audit: &Audit,
    eyes: &[DVec3],
    gazes: &[DVec3],
    control: &Control,
    draw: D,
) -> Result<Vec<Found>, Error>
where
    D: Fn(usize, &mut Vec<bool>) -> Result<Option<usize>, Error> + Sync,
{
    (0..eyes.len())
        .into_par_iter()
        .map_init(Vec::new, |drawn, index| {
            drawn.clear();
            drawn.resize(audit.groups.len(), false);
            let image = draw(index, drawn)?;
            control.step(1)?;
            Ok(audit.frame(eyes[index], gazes[index], drawn, image))
        })
        .collect()
}

//! The star-shape of a viewpoint (section 3.4.1): how far away an eye can be that has it as the closest viewpoint in
//! its reverse frustum.
//!
//! The dissertation fits spheres of twice and three times the spacing; at 60 by 46.8 degrees an eye 2.27 spacings away
//! breaks the first. Here the greatest distance is found by branch and bound, for any field of view, and certified:
//! between two bounds that are as near to each other as asked.
//!
//! Write an eye as `e = l (f + a t_x r + b t_y u)` around the viewpoint, with `f, r, u` the axes of the gaze and `a, b`
//! in [-1, 1]: that is, the viewpoint is in its reverse frustum. Another viewpoint `w` takes the eye over if it is
//! nearer, `l > |w|^2 / (2 w.(f + ...))`, and in the reverse frustum too: `l (1 + a) > w.f + w.r / t_x`, and so for the
//! other three planes. All of those are lower bounds on `l`. So along each ray the eyes of the star-shape are those
//! up to a distance that has a closed form, and what is searched are `a`, `b` and the gaze.

use super::directions::Upright;
use super::frustum::{Field, Frustum};
use crate::bounds::Bounds;
use crate::control::Control;
use crate::error::Error;
use glam::DVec3;
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};
use std::sync::Arc;

/// Which gazes eyes may have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gazes {
    /// Level ones, between two yaws; the second is not less than the first.
    Yaw(f64, f64),
    /// All, level with the horizon from side to side. Near the poles, where `up` says little, also those that take
    /// the next axis for it.
    Sphere,
}

/// How near the gaze is to the poles where the next axis is up: cosine of the angle to `up`.
const POLE: f64 = 0.999;

/// A question: which eyes can have the viewpoint at zero as their closest.
#[derive(Debug, Clone)]
pub struct Star<'a> {
    /// The other viewpoints, around this one.
    pub others: &'a [DVec3],
    pub field: Field,
    pub upright: Upright,
    pub gazes: Gazes,
    /// Where eyes are, around the viewpoint; everywhere if `None`.
    pub domain: Option<Bounds>,
}

/// The answer: the greatest distance is between the bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radius {
    pub low: f64,
    pub high: f64,
    /// An eye (around the viewpoint) and its gaze at the lower bound; eyes as near to it as you like have the viewpoint
    /// as their closest. Both zero if there is no such eye; a direction without end if the bounds are infinite.
    pub eye: DVec3,
    pub forward: DVec3,
    /// How many boxes were searched.
    pub boxes: usize,
}

/// Part of the search: ranges of a, b, yaw and pitch, and a bound of the distance in it.
#[derive(Debug, Clone)]
struct Part {
    low: [f64; 4],
    high: [f64; 4],
    bound: f64,
    /// Whether `up` is the next axis.
    polar: bool,
    /// The viewpoints that may be the first to take over the eyes of some ray of the part.
    rivals: Arc<[u32]>,
}

impl PartialEq for Part {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Part {}

impl PartialOrd for Part {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Part {
    /// By bound, and then by place, so that the order of the search is always the same.
    fn cmp(&self, other: &Self) -> Ordering {
        let places = |p: &Self| p.low.map(|x| x + 0.0);
        self.bound.total_cmp(&other.bound).then_with(|| {
            let pairs = places(self).into_iter().zip(places(other));
            pairs.map(|(a, b)| a.total_cmp(&b)).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
        })
    }
}

impl Star<'_> {
    /// Searches until the bounds are within `tolerance` of each other, relatively, or `most` parts were looked at.
    ///
    /// Where nothing takes eyes over, however far they are, both bounds are infinite.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn radius(&self, tolerance: f64, most: usize, control: &Control) -> Result<Radius, Error> {
        let mut found = Radius { low: 0.0, high: 0.0, eye: DVec3::ZERO, forward: DVec3::ZERO, boxes: 0 };
        let mut queue = BinaryHeap::from(self.start());
        while let Some(part) = queue.pop() {
            found.high = part.bound.max(found.low);
            if part.bound <= found.low * (1.0 + tolerance) || found.boxes >= most {
                return Ok(found);
            }
            found.boxes += 1;
            if found.boxes.is_multiple_of(1024) {
                control.step(0)?;
            }
            let axis = self.widest(&part);
            let middle = (part.low[axis] + part.high[axis]) / 2.0;
            for upper in [false, true] {
                let mut half = part.clone();
                if upper {
                    half.low[axis] = middle
                } else {
                    half.high[axis] = middle
                }
                self.try_middle(&half, &mut found);
                if found.low == f64::INFINITY {
                    found.high = f64::INFINITY;
                    return Ok(found);
                }
                half.bound = self.bound(&mut half).min(part.bound);
                if half.bound > found.low {
                    queue.push(half);
                }
            }
        }
        found.high = found.low;
        Ok(found)
    }

    /// All that is to be searched; less, where the viewpoints lie the same way seen in mirrors.
    fn start(&self) -> Vec<Part> {
        let everyone: Arc<[u32]> = (0..self.others.len() as u32).collect();
        let all = |yaw: (f64, f64), pitch: (f64, f64), polar| Part {
            low: [-1.0, -1.0, yaw.0, pitch.0],
            high: [1.0, 1.0, yaw.1, pitch.1],
            bound: f64::INFINITY,
            polar,
            rivals: everyone.clone(),
        };
        match self.gazes {
            Gazes::Yaw(from, to) if to - from < TAU => vec![all((from, to), (0.0, 0.0), false)],
            Gazes::Yaw(..) => vec![all((0.0, self.turn()), (0.0, 0.0), false)],
            Gazes::Sphere => {
                let down = if self.same(|v| [v[0], v[1], -v[2]]) { 0.0 } else { -FRAC_PI_2 };
                // Around the next axis, the pole is a quarter turn away: a square of directions around both of them.
                let cap = POLE.acos() * 1.01;
                let pole = |yaw| all((yaw - cap, yaw + cap), (-cap, cap), true);
                vec![all((0.0, self.turn()), (down, FRAC_PI_2), false), pole(FRAC_PI_2), pole(-FRAC_PI_2)]
            }
        }
    }

    /// The yaws from 0 that mirrors make all others of.
    fn turn(&self) -> f64 {
        let sides = self.same(|v| [-v[0], v[1], v[2]]) && self.same(|v| [v[0], -v[1], v[2]]);
        match (sides, self.same(|v| [v[1], v[0], v[2]])) {
            (true, true) => FRAC_PI_4,
            (true, false) => FRAC_PI_2,
            _ => TAU,
        }
    }

    /// Whether a mirror changes nothing, in the coordinates of [`Upright`].
    fn same(&self, mirror: impl Fn([f64; 3]) -> [f64; 3]) -> bool {
        let sorted = |mut points: Vec<[f64; 3]>| {
            points.sort_by(|a, b| {
                let pairs = a.iter().zip(b);
                pairs.map(|(x, y)| x.total_cmp(y)).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
            });
            points
        };
        let plain = |v: [f64; 3]| v.map(|x| x + 0.0);
        let at: Vec<_> = self.others.iter().map(|&w| plain(self.upright.local(w))).collect();
        let domain = self.domain.is_none_or(|d| {
            let local = self.upright.local_bounds(&d, DVec3::ZERO);
            let corners = [local.low, local.high].map(|c| plain(mirror(c.to_array())));
            Bounds::of(corners.map(DVec3::from_array)) == local
        });
        let mirrored = at.iter().map(|&v| plain(mirror(v))).collect();
        domain && sorted(at.clone()) == sorted(mirrored)
    }

    /// The axes of a gaze.
    fn axes(&self, yaw: f64, pitch: f64, polar: bool) -> Frustum {
        let upright = if polar { self.upright.next() } else { self.upright };
        let level = upright.forward(yaw);
        let forward = level * pitch.cos() + upright.up() * pitch.sin();
        let up = upright.up() * pitch.cos() - level * pitch.sin();
        Frustum::new(DVec3::ZERO, forward, up, self.field)
    }

    /// Which range to halve: where a step moves the eye's ray most.
    fn widest(&self, part: &Part) -> usize {
        let moves = [self.field.tan_x, self.field.tan_y, 1.0, 1.0];
        let width = |i: usize| (part.high[i] - part.low[i]) * moves[i];
        (1..4).fold(0, |best, i| if width(i) > width(best) { i } else { best })
    }

    /// The distance along the ray in the middle of a part: a lower bound.
    fn try_middle(&self, part: &Part, found: &mut Radius) {
        let [a, b, yaw, pitch]: [f64; 4] = std::array::from_fn(|i| (part.low[i] + part.high[i]) / 2.0);
        let axes = self.axes(yaw, pitch, part.polar);
        let ray = axes.forward + axes.right * (a * self.field.tan_x) + axes.up * (b * self.field.tan_y);
        let mut far = f64::INFINITY;
        for &rival in &*part.rivals {
            let w = self.others[rival as usize];
            let nearer = w.dot(ray);
            if nearer > 0.0 {
                let (x, y, z) = self.scaled(&axes, w);
                let planes = [
                    quotient(z + x, 1.0 + a),
                    quotient(z - x, 1.0 - a),
                    quotient(z + y, 1.0 + b),
                    quotient(z - y, 1.0 - b),
                ];
                far = far.min(planes.into_iter().fold(w.length_squared() / (2.0 * nearer), f64::max));
            }
        }
        if let Some(domain) = self.domain {
            let (enter, leave) = crossing(&domain, ray, ray);
            if enter > far.min(leave) {
                return;
            }
            far = far.min(leave);
        }
        let distance = far * ray.length();
        if distance > found.low {
            let eye = if far.is_finite() { ray * far } else { ray.normalize() };
            *found = Radius { low: distance, eye, forward: axes.forward, ..*found };
        }
    }

    /// A viewpoint across, up and ahead, in half-widths of the field.
    fn scaled(&self, axes: &Frustum, w: DVec3) -> (f64, f64, f64) {
        (w.dot(axes.right) / self.field.tan_x, w.dot(axes.up) / self.field.tan_y, w.dot(axes.forward))
    }

    /// No eye on a ray of the part is farther away than this. Drops rivals that never come first.
    fn bound(&self, part: &mut Part) -> f64 {
        let mid = |i: usize| (part.low[i] + part.high[i]) / 2.0;
        let half = |i: usize| (part.high[i] - part.low[i]) / 2.0;
        let axes = self.axes(mid(2), mid(3), part.polar);
        let (tx, ty) = (self.field.tan_x, self.field.tan_y);
        let middle = axes.forward + axes.right * (mid(0) * tx) + axes.up * (mid(1) * ty);
        let longest = |i: usize| part.low[i].abs().max(part.high[i].abs());
        let length = (1.0 + (longest(0) * tx).powi(2) + (longest(1) * ty).powi(2)).sqrt();
        // Turning by an angle moves a unit vector by twice the sine of half of it, and the ray by that and its own ranges.
        let angle = half(2) + half(3);
        let turn = if angle < FRAC_PI_2 { 2.0 * (angle / 2.0).sin() } else { 2.0 };
        let shift = half(0) * tx + half(1) * ty + turn * length;
        // z + x / t is a product with a vector of length sqrt(1 + 1 / t^2).
        let slack = |tan: f64| turn * (1.0 + 1.0 / (tan * tan)).sqrt();
        let (slack_x, slack_y) = (slack(tx), slack(ty));
        // One plus and minus a and b: at least, at most.
        let (low, high) = (&part.low, &part.high);
        let least = [1.0 + low[0], 1.0 - high[0], 1.0 + low[1], 1.0 - high[1]];
        let greatest = [1.0 + high[0], 1.0 - low[0], 1.0 + high[1], 1.0 - low[1]];
        let mut far = f64::INFINITY;
        let mut firsts = Vec::with_capacity(part.rivals.len());
        for &rival in &*part.rivals {
            let w = self.others[rival as usize];
            let (along, size) = (w.dot(middle), w.length());
            let reach = shift * size;
            if along + reach <= 0.0 {
                continue;
            }
            let (x, y, z) = self.scaled(&axes, w);
            let needs = [z + x, z - x, z + y, z - y];
            let slacks = [slack_x, slack_x, slack_y, slack_y].map(|s| s * size);
            let half_square = size * size / 2.0;
            let first = (0..4).fold(half_square / (along + reach), |l, i| {
                l.max(quotient(needs[i] - slacks[i], greatest[i]))
            });
            if first >= far {
                continue;
            }
            firsts.push((first, rival));
            if along > reach {
                let last = (0..4).fold(half_square / (along - reach), |l, i| {
                    l.max(quotient(needs[i] + slacks[i], least[i]))
                });
                far = far.min(last);
            }
        }
        if 2 * firsts.len() < part.rivals.len() {
            part.rivals = firsts.iter().filter(|f| f.0 <= far).map(|f| f.1).collect();
        }
        if let Some(domain) = self.domain {
            let reach = DVec3::splat(shift);
            let (enter, leave) = crossing(&domain, middle - reach, middle + reach);
            if enter > far.min(leave) {
                return 0.0;
            }
            far = far.min(leave);
            // However it gets there, an eye of the domain is no farther than its farthest corner.
            return (far * length).min(domain.low.abs().max(domain.high.abs()).length());
        }
        far * length
    }
}

/// `a / b` for `b >= 0`, where nothing divided by zero is nothing.
fn quotient(a: f64, b: f64) -> f64 {
    if a <= 0.0 { 0.0 } else { a / b }
}

/// Between which multiples some ray from zero, with components between `low` and `high`, can be in a box: no ray is in
/// it before the first or after the second.
fn crossing(domain: &Bounds, low: DVec3, high: DVec3) -> (f64, f64) {
    (0..3).fold((0.0_f64, f64::INFINITY), |(enter, leave), i| {
        let (from, to, l, h) = (domain.low[i], domain.high[i], low[i], high[i]);
        let first = if from > 0.0 {
            if h > 0.0 { from / h } else { f64::INFINITY }
        } else if to < 0.0 {
            if l < 0.0 { to / l } else { f64::INFINITY }
        } else {
            0.0
        };
        let last = if l > 0.0 {
            to / l
        } else if h < 0.0 {
            from / h
        } else {
            f64::INFINITY
        };
        (enter.max(first), leave.min(last))
    })
}

/// The viewpoints of an infinite grid that can matter to the one at zero, in units of the spacing: those within
/// `reach`. Odd levels lack the places with two odd coordinates (figure 3-11), and `parity` says which place this is.
pub fn lattice(odd: bool, place: [i32; 3], reach: f64) -> Vec<DVec3> {
    let most = reach.floor() as i32;
    let range = -most..=most;
    let mut points = Vec::new();
    for x in range.clone() {
        for y in range.clone() {
            for z in range.clone() {
                let at = DVec3::new(x.into(), y.into(), z.into());
                let odds = [x + place[0], y + place[1], z + place[2]].iter().filter(|c| *c & 1 == 1).count();
                if at != DVec3::ZERO && at.length() <= reach && !(odd && odds == 2) {
                    points.push(at);
                }
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NEVER: usize = 1 << 20;

    fn field(fov_x: f64, fov_y: f64) -> Field {
        let tan = |degrees: f64| (degrees.to_radians() / 2.0).tan();
        Field { tan_x: tan(fov_x), tan_y: tan(fov_y) }
    }

    fn star(others: &[DVec3], field: Field, gazes: Gazes) -> Star<'_> {
        Star { others, field, upright: Upright::new(DVec3::Y).unwrap(), gazes, domain: None }
    }

    /// How far an eye of an infinite grid can be at all: a ball of the covering radius in the reverse frustum holds
    /// some viewpoint.
    fn loose(covering: f64, field: Field) -> f64 {
        covering * (1.0 + 1.0 / field.tan_x.min(field.tan_y).atan().sin())
    }

    /// By the definition, asking every viewpoint.
    fn is_closest(others: &[DVec3], eye: DVec3, forward: DVec3, up: DVec3, field: Field) -> bool {
        let behind = |w: DVec3| Frustum::new(w, forward, up, field).contains(eye);
        behind(DVec3::ZERO) && others.iter().all(|&w| w.distance(eye) >= eye.length() || !behind(w))
    }

    #[test]
    fn radii_of_grids_are_no_less_than_eyes_that_were_found() {
        // Distances that hill climbing from random eyes reached, to the digits given.
        let found = [
            (60.0, 60.0, 2.00, 2.33, 2.64),
            (60.0, 46.8, 2.27, 2.34, 2.74),
            (54.0, 54.0, 2.15, 2.47, 2.82),
            (45.0, 45.0, 2.46, 2.78, 3.20),
        ];
        for (x, y, even, any, odd) in found {
            let field = field(x, y);
            let grid = lattice(false, [0; 3], 2.0 * loose(0.75_f64.sqrt(), field));
            for (gazes, least) in [(Gazes::Yaw(0.0, TAU), even), (Gazes::Sphere, any)] {
                let r = star(&grid, field, gazes).radius(0.01, NEVER, &Control::default()).unwrap();
                assert!(r.high >= least - 0.005 && r.high <= 1.01 * r.low && r.low >= 0.99 * least, "{r:?}");
                assert!((r.eye.length() - r.low).abs() < 1e-12);
                if gazes != Gazes::Sphere {
                    assert!(is_closest(&grid, r.eye * (1.0 - 1e-9), r.forward, DVec3::Y, field));
                }
            }
            let radii = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]].map(|place| {
                let grid = lattice(true, place, 2.0 * loose(1.0, field));
                star(&grid, field, Gazes::Yaw(0.0, TAU))
                    .radius(0.01, NEVER, &Control::default())
                    .unwrap()
                    .high
            });
            assert!(radii.into_iter().fold(0.0, f64::max) >= odd - 0.005, "{radii:?}");
        }
    }

    #[test]
    fn alone_a_viewpoint_serves_eyes_without_end() {
        let control = Control::default();
        let r = star(&[], field(60.0, 46.8), Gazes::Sphere).radius(0.01, NEVER, &control).unwrap();
        assert_eq!((r.low, r.high), (f64::INFINITY, f64::INFINITY));
        let domain = Some(Bounds { low: DVec3::splat(-1.0), high: DVec3::splat(2.0) });
        let star = Star { domain, ..star(&[], field(60.0, 46.8), Gazes::Sphere) };
        let r = star.radius(0.001, NEVER, &control).unwrap();
        let corner = 12.0_f64.sqrt();
        assert!(r.high <= corner && r.low >= 0.99 * corner);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]
        #[test]
        fn no_eye_is_farther_than_the_radius(
            shifts in prop::collection::vec(prop::array::uniform3(-0.3..0.3_f64), 342),
            eyes in prop::collection::vec((prop::array::uniform3(-1.0..1.0_f64), 0.0..TAU, -1.5..1.5_f64), 2000),
            level in any::<bool>(), bounded in any::<bool>(),
        ) {
            let field = field(90.0, 75.0);
            let points: Vec<_> =
                lattice(false, [0; 3], 6.0).into_iter().filter(|p| p.abs().max_element() <= 3.0).collect();
            let others: Vec<_> = points.iter().zip(&shifts).map(|(&p, &s)| p + DVec3::from(s)).collect();
            let domain = bounded.then_some(Bounds { low: DVec3::splat(-0.5), high: DVec3::splat(0.8) });
            let gazes = if level { Gazes::Yaw(0.0, TAU) } else { Gazes::Sphere };
            let star = Star { domain, ..star(&others, field, gazes) };
            let r = star.radius(0.02, 1 << 14, &Control::default()).unwrap();
            for (eye, yaw, pitch) in eyes {
                let level_gaze = star.upright.forward(yaw);
                let pitch = if level { 0.0 } else { pitch };
                let forward = level_gaze * pitch.cos() + DVec3::Y * pitch.sin();
                let eye = DVec3::from(eye) * 2.5;
                let inside = domain.is_none_or(|d| d.contains(eye));
                if inside && is_closest(&others, eye, forward, DVec3::Y, field) {
                    prop_assert!(eye.length() <= r.high * (1.0 + 1e-12), "{} past {}", eye, r.high);
                }
            }
            if level && r.low > 0.0 {
                prop_assert!(is_closest(&others, r.eye * (1.0 - 1e-9), r.forward, DVec3::Y, field));
            }
        }
    }
}

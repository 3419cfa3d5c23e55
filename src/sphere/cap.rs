//! Which faces a cone of directions meets, and how wide the cone is for an eye off the sampling sphere.

use glam::DVec3;
use std::f64::consts::FRAC_PI_2;

/// Angles are widened by this much, some hundred roundings, so that rounding loses no face.
const SLACK: f64 = 1e-12;

/// The faces, in order, that come within `angle` radians of the unit vector `direction`.
///
/// `points` are unit vectors. Conservative: a face that is farther by less than 10^-12 may be among them.
pub fn faces_in_cap(points: &[DVec3], faces: &[[u32; 3]], direction: DVec3, angle: f64) -> Vec<u32> {
    let within = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|v| points[v as usize]);
        let inside = [(a, b), (b, c), (c, a)].iter().all(|(a, b)| normal(*a, *b).dot(direction) >= 0.0);
        let nearest = || {
            angle_to_arc(direction, a, b)
                .min(angle_to_arc(direction, b, c))
                .min(angle_to_arc(direction, c, a))
        };
        inside || nearest() <= angle + SLACK
    };
    (0..faces.len() as u32).filter(|&f| within(&faces[f as usize])).collect()
}

/// The angle between `d` and the nearest point of the shorter arc from `a` to `b`; all are unit vectors.
fn angle_to_arc(d: DVec3, a: DVec3, b: DVec3) -> f64 {
    let to_ends = d.angle_between(a).min(d.angle_between(b));
    let normal = normal(a, b);
    // Over the arc itself if the foot of the perpendicular lies between its ends.
    let over = normal.cross(a).dot(d) > 0.0 && b.cross(normal).dot(d) > 0.0;
    if over && normal != DVec3::ZERO {
        // From the plane's angle, exact near zero where an arc cosine is not.
        to_ends.min(normal.dot(d).abs().atan2(normal.cross(d).length()))
    } else {
        to_ends
    }
}

/// Across the arc from `a` to `b`, to its left: twice `a × b`, but accurate for the shortest arcs too,
/// because the difference of near vectors is.
fn normal(a: DVec3, b: DVec3) -> DVec3 {
    (a + b).cross(b - a)
}

/// The largest angle at the centre between an eye and the points where its rays cross the sampling sphere,
/// for rays that meet a ball of `radius` around the centre; the eye is `eye_distance` (may be infinite)
/// away.
///
/// A ray at distance `h ≤ radius` from the centre passes its foot at `acos(h / d)` from the eye's
/// direction and meets the sphere of radius `R` at `acos(h / R)` from that foot: at `asin(h / R) - asin(h /
/// d)` from the eye, which grows with `h` if `d > R`. If `d < R` the line meets the sphere behind the eye,
/// at the same angle with its sign changed; nothing of the ball lies between.
pub fn crossing_angle(radius: f64, sampling_radius: f64, eye_distance: f64) -> f64 {
    let seen = |from: f64| (radius / from).min(1.0).asin();
    (seen(sampling_radius) - seen(eye_distance)).abs().min(FRAC_PI_2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::octahedron::octahedron;

    #[test]
    fn an_octants_middle_sees_its_neighbours_from_35_degrees_on() {
        let sphere = octahedron(0).unwrap();
        let middle = DVec3::ONE.normalize();
        // The edge's middle is at asin(1 / sqrt 3) = 35.26 degrees, the corner at 54.74.
        let count =
            |degrees: f64| faces_in_cap(&sphere.points, &sphere.faces, middle, degrees.to_radians()).len();
        assert_eq!([0.0, 35.2, 35.3, 54.7, 54.8, 180.0].map(count), [1, 1, 4, 4, 7, 8]);
    }

    #[test]
    fn tiny_faces_are_met_no_earlier_than_they_should_be() {
        // A face a hundred thousandth of a radian wide, 0.3 radians away along y, its nearest edge across
        // the way.
        let (near, far, wide) = (0.3_f64, 0.3 + 1e-5, 1e-5);
        let at = |angle: f64, side: f64| DVec3::new(angle.cos(), angle.sin(), side).normalize();
        let points = [at(near, -wide), at(far, 0.0), at(near, wide)];
        let met = |angle: f64| !faces_in_cap(&points, &[[0, 1, 2]], DVec3::X, angle).is_empty();
        // The edge's middle is at 0.3 to within its sagitta, 10^-11; measured on the great circle it is
        // exact.
        let middle = (points[0] + points[2]).angle_between(DVec3::X);
        assert!(met(middle + 1e-14) && !met(middle - 1e-11));
        assert!(!faces_in_cap(&points, &[[0, 1, 2]], at(near + 1e-6, 0.0), 0.0).is_empty());
    }

    #[test]
    fn a_far_eye_looks_past_the_sphere_by_the_angle_of_the_ball() {
        assert_eq!(crossing_angle(1.0, 2.0, 2.0), 0.0);
        assert!((crossing_angle(1.0, 2.0, f64::INFINITY) - 30_f64.to_radians()).abs() < 1e-15);
        assert!((crossing_angle(1.0, f64::INFINITY, 2.0) - 30_f64.to_radians()).abs() < 1e-15);
        assert_eq!(crossing_angle(1.0, 1.0, f64::INFINITY), FRAC_PI_2);
    }

    #[test]
    fn a_nearer_eye_looks_past_the_sphere_on_its_other_side() {
        // From sqrt 2 away a unit ball spans 45 degrees to either side, from 2 away 30.
        assert!((crossing_angle(1.0, 2.0, 2_f64.sqrt()).to_degrees() - 15.0).abs() < 1e-12);
    }
}

//! Whether a triangle and a box have a point in common.

use crate::bounds::Bounds;
use glam::DVec3;

/// What rounding may add to a distance, for a unit of an axis's length.
///
/// Derived: a corner less the box's centre is at most 4 in each coordinate in the mesh's own units, and is off by half a unit
/// in the last place; a product of it with an edge, the sum of two such, and the box's reach, which has the same size, have at
/// most 6 roundings each of half of `f64::EPSILON`: `2 * 4 * 2 * 6 * EPSILON / 2`, and twice that to be safe.
const SLACK: f64 = 96.0 * f64::EPSILON;

/// Whether a triangle reaches into a box or touches it, by the theorem of separating axes: the box's three, the
/// triangle's plane, and the nine products of their edges.
///
/// Coordinates are a mesh's own, so at most 1 and a bit. Where rounding leaves it open, the answer is yes.
pub fn overlaps(corners: [DVec3; 3], bounds: &Bounds) -> bool {
    let own = Bounds::of(corners);
    if own.low.cmpgt(bounds.high).any() || own.high.cmplt(bounds.low).any() {
        return false;
    }
    let (center, half) = (bounds.center(), bounds.size() * 0.5);
    let [a, b, c] = corners.map(|p| p - center);
    let edges = [b - a, c - b, a - c];
    let normal = edges[0].cross(edges[1]);
    let length = edges[0].abs().element_sum() * edges[1].abs().element_sum();
    if normal.dot(a).abs() > half.dot(normal.abs()) + SLACK * length {
        return false;
    }
    // The axis is the product of a box's axis and an edge: of the third corner's distance along it and one end's, as both ends have the same.
    !edges.iter().zip([(a, c), (b, a), (c, b)]).any(|(edge, (end, other))| {
        (0..3).any(|x| {
            let (y, z) = ((x + 1) % 3, (x + 2) % 3);
            let along = |p: DVec3| edge[y] * p[z] - edge[z] * p[y];
            let (s, t) = (along(end), along(other));
            let reach =
                half[y] * edge[z].abs() + half[z] * edge[y].abs() + SLACK * (edge[y].abs() + edge[z].abs());
            s.min(t) > reach || s.max(t) < -reach
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const UNIT: Bounds = Bounds { low: DVec3::ZERO, high: DVec3::ONE };

    #[test]
    fn touching_counts_and_a_near_miss_does_not() {
        let touching = [DVec3::new(1.0, 0.5, 0.5), DVec3::new(2.0, 0.0, 0.0), DVec3::new(2.0, 1.0, 0.0)];
        assert!(overlaps(touching, &UNIT));
        // Past the corner (1, 1, 1), parallel to the plane x + y + z = 3: only the triangle's plane separates it.
        let past = |d: f64| {
            [
                DVec3::new(4.0 + d, -0.5, -0.5),
                DVec3::new(-0.5, 4.0 + d, -0.5),
                DVec3::new(-0.5, -0.5, 4.0 + d),
            ]
        };
        assert!(overlaps(past(0.0), &UNIT) && !overlaps(past(1e-12), &UNIT));
        // Beside an edge of the box: only a product of edges separates it.
        let beside = |d: f64| {
            [DVec3::new(2.0 + d, 0.0, 0.2), DVec3::new(0.0, 2.0 + d, 0.8), DVec3::new(2.0, 2.0, 0.5)]
        };
        assert!(overlaps(beside(0.0), &UNIT) && !overlaps(beside(1e-2), &UNIT));
    }

    #[test]
    fn segments_and_points_are_triangles_too() {
        let point = |x: f64| [DVec3::splat(x); 3];
        assert!(overlaps(point(1.0), &UNIT) && !overlaps(point(1.0 + 1e-15), &UNIT));
        let segment = |d: f64| {
            [DVec3::new(2.0 + d, 0.0, 0.5), DVec3::new(0.0, 2.0 + d, 0.5), DVec3::new(2.0 + d, 0.0, 0.5)]
        };
        assert!(overlaps(segment(0.0), &UNIT) && !overlaps(segment(1e-12), &UNIT));
    }

    proptest! {
        /// A triangle with a point in the box overlaps it, and cells that share their sides leave no gap.
        #[test]
        fn no_point_of_a_triangle_is_lost_between_cells(
            corners in prop::array::uniform3(prop::array::uniform3(-1.0..1.0_f64)),
            weights in prop::array::uniform3(0.0..1.0_f64),
            middle in prop::array::uniform3(-1.0..1.0_f64),
        ) {
            let corners = corners.map(DVec3::from);
            let sum: f64 = weights.iter().sum();
            prop_assume!(sum > 0.0);
            let point = corners[0] * (weights[0] / sum) + corners[1] * (weights[1] / sum) + corners[2] * (weights[2] / sum);
            let middle = DVec3::from(middle);
            let outer = [DVec3::NEG_ONE, DVec3::ONE];
            let mask = point.cmpge(middle);
            let cell = Bounds {
                low: DVec3::select(mask, middle, outer[0]),
                high: DVec3::select(mask, outer[1], middle),
            };
            prop_assert!(overlaps(corners, &cell));
        }
    }
}

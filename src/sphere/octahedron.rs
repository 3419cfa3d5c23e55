//! The octahedral sampling sphere of the patches paper (2002, section 3.2.1).

use super::direction::normalized;
use crate::error::Error;
use glam::DVec3;
use std::collections::HashMap;

/// Deepest subdivision on offer: 4,194,306 points, a hundred megabytes of them.
pub const MAX_LEVEL: u32 = 10;

/// An octahedron whose faces were split in four `level` times, every midpoint moved out to the unit sphere.
#[derive(Debug, Clone, PartialEq)]
pub struct Octahedron {
    /// `4^(level + 1) + 2` unit vectors: the axes (`+x -x +y -y +z -z`), then those of each level in turn.
    pub points: Vec<DVec3>,
    /// `8 · 4^level` faces. The children of face `f` are `4 f .. 4 f + 4` one level deeper: those at its
    /// three corners, in order, then the one in its middle.
    pub faces: Vec<[u32; 3]>,
}

/// Builds the sphere of `level`. Its points are symmetric to the bit under all 48 symmetries of the
/// octahedron.
///
/// # Errors
/// [`Error::Invalid`] above [`MAX_LEVEL`].
pub fn octahedron(level: u32) -> Result<Octahedron, Error> {
    if level > MAX_LEVEL {
        return Err(Error::Invalid(format!("level must be at most {MAX_LEVEL}, got {level}")));
    }
    let mut points = Vec::with_capacity((4 << (2 * level)) + 2);
    points.extend([DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z]);
    let mut faces: Vec<[u32; 3]> = (0..8).map(octant).collect();
    for _ in 0..level {
        let mut middles = HashMap::with_capacity(faces.len() * 3 / 2);
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push(normalized(points[a as usize] + points[b as usize]));
                points.len() as u32 - 1
            })
        };
        faces = faces
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    Ok(Octahedron { points, faces })
}

/// The face of octant `o`, whose bits 0, 1, 2 say that x, y, z are negative.
fn octant(o: u32) -> [u32; 3] {
    let [x, y, z] = [o & 1, 2 + (o >> 1 & 1), 4 + (o >> 2 & 1)];
    if o.count_ones().is_multiple_of(2) { [x, y, z] } else { [x, z, y] }
}

/// The face of level 0 that holds `d`.
pub(super) fn octant_of(d: DVec3) -> u32 {
    u32::from(d.x < 0.0) | u32::from(d.y < 0.0) << 1 | u32::from(d.z < 0.0) << 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::direction::side;
    use glam::Vec3Swizzles as _;
    use std::collections::HashSet;

    #[test]
    fn sizes_are_the_papers() {
        for (level, count) in [6, 18, 66, 258, 1026, 4098].into_iter().enumerate() {
            let sphere = octahedron(level as u32).unwrap();
            assert_eq!(sphere.points.len(), count);
            assert_eq!(sphere.faces.len(), 8 << (2 * level));
        }
        assert!(octahedron(MAX_LEVEL + 1).is_err());
    }

    #[test]
    fn coarse_points_come_first() {
        let (coarse, fine) = (octahedron(2).unwrap(), octahedron(3).unwrap());
        assert_eq!(coarse.points, fine.points[..coarse.points.len()]);
        for (f, face) in coarse.faces.iter().enumerate() {
            for (corner, child) in fine.faces[4 * f..4 * f + 3].iter().enumerate() {
                assert_eq!(face[corner], child[corner]);
            }
        }
    }

    #[test]
    fn faces_wind_outward_and_hold_their_own_octant() {
        for (o, &[a, b, c]) in octahedron(0).unwrap().faces.iter().enumerate() {
            let points = octahedron(0).unwrap().points;
            let [a, b, c] = [a, b, c].map(|v| points[v as usize]);
            assert!(side(a, b, c) > 0.0);
            assert_eq!(octant_of(a + b + c), o as u32);
        }
    }

    #[test]
    fn points_are_symmetric_to_the_bit() {
        let points = octahedron(4).unwrap().points;
        let bits = |p: DVec3| p.to_array().map(|x| (x + 0.0).to_bits());
        let all: HashSet<_> = points.iter().map(|&p| bits(p)).collect();
        for p in points {
            for q in [p.yzx(), DVec3::new(p.y, p.x, p.z), DVec3::new(-p.x, p.y, p.z)] {
                assert!(all.contains(&bits(q)));
            }
        }
    }
}

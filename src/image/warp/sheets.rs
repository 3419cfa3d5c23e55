//! The order in which samples of an image may be drawn, one over the other, without comparing their depths.
//!
//! Two samples that fall on the same point of the target lie on one line through the epipole, the target's eye as the source
//! sees it, and the nearer is the one nearer to the epipole, or farther from it where the eye is behind the source. So the
//! lines through the epipole cut the image into up to four sheets, each drawn row by row toward the epipole or away from it
//! (section 4.2.1 of the 1998 dissertation; McMillan's occlusion-compatible order).
//!
//! This is exact for points. Samples fall on pixels: two of neighbouring rows may fall on one pixel though their lines differ,
//! and then the row decides, not the depth.

use super::mapping::Mapping;
use std::ops::Range;

/// Part of an image that is drawn in one direction.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sheet {
    pub columns: Range<usize>,
    pub rows: Range<usize>,
    /// Columns are drawn from the last to the first.
    pub leftward: bool,
    /// Rows are drawn from the last to the first.
    pub upward: bool,
}

impl Sheet {
    /// The whole image, top row first, each from left to right.
    pub fn whole(width: usize, height: usize) -> Self {
        Self { columns: 0..width, rows: 0..height, leftward: false, upward: false }
    }

    /// The rows as they are drawn.
    pub fn lines(&self) -> impl Iterator<Item = usize> + use<> {
        let Range { start, end } = self.rows;
        let upward = self.upward;
        (start..end).map(move |y| if upward { start + end - 1 - y } else { y })
    }
}

/// The sheets of an image of the source's size, in an order in which they may be drawn: one, two or four, each with pixels.
pub fn sheets(mapping: &Mapping, width: usize, height: usize) -> Vec<Sheet> {
    let e = mapping.epipole;
    let mut sheets = Vec::with_capacity(4);
    for (rows, upward) in halves(e.y, e.z, height) {
        for (columns, leftward) in halves(e.x, e.z, width) {
            sheets.push(Sheet { columns, rows: rows.clone(), leftward, upward });
        }
    }
    sheets
}

/// Ranges of pixels along an axis, and whether they are drawn backward, of an epipole at `e / w`.
///
/// A pixel centre `p` is drawn forward where `e - w p` is positive: before the epipole if the eye is in front (`w > 0`),
/// after it if behind, and everywhere or nowhere if it is at infinity.
fn halves(e: f64, w: f64, count: usize) -> impl Iterator<Item = (Range<usize>, bool)> {
    let backward = |pixel: usize| e - w * (pixel as f64 + 0.5) < 0.0;
    let pixels = 0..count;
    let first = count > 0 && backward(0);
    // The function is monotone: it changes its sign once at most.
    let (mut low, mut high) = (0, count);
    while low < high {
        let middle = (low + high) / 2;
        if backward(middle) == first {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    [(pixels.start..low, first), (low..pixels.end, !first)].into_iter().filter(|(range, _)| !range.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Projection};
    use glam::{DMat3, DVec3, dvec3};
    use proptest::prelude::*;

    const SIZE: (usize, usize) = (40, 30);

    fn camera(eye: DVec3, turn: [f64; 2]) -> Camera {
        let rotation = DMat3::from_rotation_x(turn[0]) * DMat3::from_rotation_y(turn[1]);
        Camera {
            k: DMat3::from_cols(dvec3(30.0, 0.0, 0.0), dvec3(0.0, 30.0, 0.0), dvec3(20.0, 15.0, 1.0)),
            rotation,
            translation: -(rotation * eye),
            width: SIZE.0,
            height: SIZE.1,
            near: 0.0,
            projection: Projection::Perspective,
        }
    }

    fn of(eye: DVec3) -> Vec<Sheet> {
        let mapping = Mapping::new(&camera(DVec3::ZERO, [0.0; 2]), &camera(eye, [0.0; 2])).unwrap();
        sheets(&mapping, SIZE.0, SIZE.1)
    }

    #[test]
    fn an_epipole_inside_makes_four_sheets_drawn_toward_it_or_away() {
        for (z, toward) in [(2.0, true), (-2.0, false)] {
            let four = of(dvec3(0.2, -0.1, z));
            assert_eq!(four.len(), 4);
            let ahead = four.iter().all(|s| s.leftward == ((s.columns.start > 0) == toward));
            assert!(ahead && four.iter().all(|s| s.upward == ((s.rows.start > 0) == toward)));
        }
    }

    #[test]
    fn an_epipole_beside_makes_two_and_one_at_infinity_or_diagonally_outside_makes_one() {
        assert_eq!(of(dvec3(2.0, 0.1, 1.0)).len(), 2);
        assert_eq!(of(dvec3(3.0, 3.0, 1.0)).len(), 1);
        assert_eq!(of(dvec3(1.0, 0.5, 0.0)).len(), 1);
        assert!(!of(dvec3(1.0, 0.5, 0.0))[0].leftward && of(dvec3(-1.0, 0.5, 0.0))[0].leftward);
        assert_eq!(of(DVec3::ZERO), vec![Sheet::whole(SIZE.0, SIZE.1)]);
    }

    proptest! {
        #[test]
        fn sheets_have_every_pixel_once(eye in prop::array::uniform3(-3.0..3.0)) {
            let mut seen = vec![0; SIZE.0 * SIZE.1];
            for sheet in of(DVec3::from_array(eye)) {
                for y in sheet.lines() {
                    seen[y * SIZE.0..][sheet.columns.clone()].iter_mut().for_each(|n| *n += 1);
                }
            }
            prop_assert!(seen.iter().all(|&n| n == 1));
        }

        #[test]
        fn of_two_samples_on_a_ray_the_nearer_is_drawn_later(
            eye in prop::array::uniform3(-2.0..2.0), turn in prop::array::uniform2(-0.5..0.5),
            at in (0.0..SIZE.0 as f64, 0.0..SIZE.1 as f64, 0.2..5.0_f64), factor in 0.5..2.0_f64,
        ) {
            let (source, target) = (camera(DVec3::ZERO, turn), camera(DVec3::from_array(eye), [0.0; 2]));
            let mapping = Mapping::new(&source, &target).unwrap();
            // Two points of a ray from the target's eye, as pixels of the source.
            let eye_there = source.rotation * DVec3::from_array(eye) + source.translation;
            let ray = source.k.inverse() * dvec3(at.0, at.1, 1.0) * at.2 - eye_there;
            let mut pixels = [1.0, factor].map(|range: f64| {
                let there = eye_there + ray * range;
                (range, source.k * there / there.z, there.z)
            });
            prop_assume!(pixels.iter().all(|(_, p, z)| *z > 0.0
                && (0.0..SIZE.0 as f64).contains(&p.x) && (0.0..SIZE.1 as f64).contains(&p.y)));
            pixels.sort_by(|a, b| b.0.total_cmp(&a.0));
            let [(far, nearer)] = [(pixels[0].1, pixels[1].1)];
            prop_assume!((far - nearer).abs().max_element() > 1e-6);
            let cell = |p: DVec3| (p.x as usize, p.y as usize);
            let order = |p: DVec3| {
                let (x, y) = cell(p);
                let all = sheets(&mapping, SIZE.0, SIZE.1);
                let which = all.iter().position(|s| s.columns.contains(&x) && s.rows.contains(&y)).unwrap();
                let s = &all[which];
                let along = |t: usize, back: bool| if back { -(t as i64) } else { t as i64 };
                (which, along(y, s.upward), along(x, s.leftward))
            };
            let (a, b) = (order(far), order(nearer));
            // Both in one sheet, except where the line touches its corner; never drawn backward along either axis.
            prop_assert!(a.0 != b.0 || (a.1 <= b.1 && a.2 <= b.2), "{a:?} {b:?}");
        }
    }
}

//! Guesses for the holes of a picture.

use crate::error::Error;

/// Which of the known pixels a hole's pixel is filled from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Of the first known pixels to the left, to the right, above and below, the farthest away from the eye: what opens up
    /// beside something near belongs to what is behind it. Of those whose disparities differ by less than 5 % the one
    /// that is fewest pixels away.
    Background,
    /// The one fewest steps to a neighbour away.
    Nearest,
}

/// Surfaces are told apart if the disparity of one is less than this share of that of the other.
const FARTHER: f32 = 0.95;

/// A pixel that isn't known yet.
const UNKNOWN: u32 = u32::MAX;

/// Neighbours of a pixel, those at its sides first.
const NEIGHBOURS: [(isize, isize); 8] =
    [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];

/// Fills holes with colours and depths of known pixels; of equally good ones the left one, then right, above, below, and those
/// at the corners in this order. What [`Method::Background`] finds no pixel for is filled as by [`Method::Nearest`].
///
/// `hole` says where to fill and stays as it is. A picture that is all hole stays empty. O(pixels).
///
/// # Errors
/// [`Error::Invalid`] if the arrays are not of one size.
pub fn fill(
    color: &mut [[u8; 3]],
    depth: &mut [f32],
    hole: &[bool],
    width: usize,
    method: Method,
) -> Result<(), Error> {
    let count = hole.len();
    if color.len() != count || depth.len() != count || width == 0 || !count.is_multiple_of(width) {
        return Err(Error::Invalid("color, depth and hole must be of one size".into()));
    }
    let mut from: Vec<u32> =
        (0..count).map(|pixel| if hole[pixel] { UNKNOWN } else { pixel as u32 }).collect();
    if method == Method::Background {
        look_along_axes(depth, hole, width, &mut from);
    }
    spread(width, &mut from);
    for pixel in 0..count {
        if hole[pixel] && from[pixel] != UNKNOWN {
            let from = from[pixel] as usize;
            (color[pixel], depth[pixel]) = (color[from], depth[from]);
        }
    }
    Ok(())
}

/// Finds for the pixels of holes the best of the first known ones to all four sides.
fn look_along_axes(depth: &[f32], hole: &[bool], width: usize, from: &mut [u32]) {
    let height = hole.len() / width;
    let mut away = vec![u32::MAX; hole.len()];
    let (w, h) = (width as isize, height as isize);
    // First pixels of lines, the step to the next line, lines, the step along them, and their length.
    let sweeps = [(0, w, h, 1, w), (w - 1, w, h, -1, w), (0, 1, w, w, h), ((h - 1) * w, 1, w, -w, h)];
    for (start, aside, lines, step, length) in sweeps {
        for line in 0..lines {
            let mut known: Option<(usize, isize)> = None;
            for k in 0..length {
                let pixel = (start + line * aside + k * step) as usize;
                if !hole[pixel] {
                    known = Some((pixel, k));
                } else if let Some((other, at)) = known {
                    let distance = (k - at) as u32;
                    let better = from[pixel] == UNKNOWN || {
                        let (new, old) = (1.0 / depth[other], 1.0 / depth[from[pixel] as usize]);
                        new < FARTHER * old || (old >= FARTHER * new && distance < away[pixel])
                    };
                    if better {
                        (from[pixel], away[pixel]) = (other as u32, distance);
                    }
                }
            }
        }
    }
}

/// Spreads what is known over what isn't, a pixel a step.
fn spread(width: usize, from: &mut [u32]) {
    let height = from.len() / width;
    let neighbours = |pixel: usize| {
        let (x, y) = ((pixel % width) as isize, (pixel / width) as isize);
        NEIGHBOURS.iter().filter_map(move |&(dx, dy)| {
            let (x, y) = (x + dx, y + dy);
            let inside = x >= 0 && y >= 0 && x < width as isize && y < height as isize;
            inside.then(|| y as usize * width + x as usize)
        })
    };
    let mut waits = vec![false; from.len()];
    let mut edge: Vec<usize> = Vec::new();
    for pixel in 0..from.len() {
        if from[pixel] == UNKNOWN && neighbours(pixel).any(|other| from[other] != UNKNOWN) {
            waits[pixel] = true;
            edge.push(pixel);
        }
    }
    while !edge.is_empty() {
        // All of a step are found before any is known.
        let found: Vec<u32> = edge
            .iter()
            .map(|&pixel| {
                let known = neighbours(pixel).map(|other| from[other]).find(|&other| other != UNKNOWN);
                known.expect("a pixel at the edge has a known neighbour")
            })
            .collect();
        for (&pixel, found) in edge.iter().zip(found) {
            from[pixel] = found;
        }
        let mut next = Vec::new();
        for &pixel in &edge {
            for other in neighbours(pixel) {
                if from[other] == UNKNOWN && !waits[other] {
                    waits[other] = true;
                    next.push(other);
                }
            }
        }
        edge = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hole_between_near_and_far_is_filled_from_either() {
        let (near, far) = ([1, 1, 1], [9, 9, 9]);
        let hole = [false, true, true, false, true];
        let start =
            ([near, [0; 3], [0; 3], far, [0; 3]], [1.0, f32::INFINITY, f32::INFINITY, 5.0, f32::INFINITY]);
        for (method, colors) in
            [(Method::Nearest, [near, near, far, far, far]), (Method::Background, [near, far, far, far, far])]
        {
            let (mut color, mut depth) = start;
            fill(&mut color, &mut depth, &hole, 5, method).unwrap();
            assert_eq!(color, colors);
        }
        // One pixel with a neighbour of each kind.
        let hole = [false, true, false];
        for (method, middle) in [(Method::Nearest, near), (Method::Background, far)] {
            let (mut color, mut depth) = ([near, [0; 3], far], [1.0, f32::INFINITY, 5.0]);
            fill(&mut color, &mut depth, &hole, 3, method).unwrap();
            assert_eq!(color[1], middle);
        }
    }

    #[test]
    fn nothing_known_stays_empty() {
        let (mut color, mut depth) = ([[0; 3]; 4], [f32::INFINITY; 4]);
        fill(&mut color, &mut depth, &[true; 4], 2, Method::Background).unwrap();
        assert_eq!((color, depth), ([[0; 3]; 4], [f32::INFINITY; 4]));
    }
}

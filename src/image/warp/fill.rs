//! Guesses for the holes of a picture.

use crate::error::Error;

/// Which of the neighbours of a hole's pixel it is filled from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The farthest: what opens up beside something near belongs to what is behind it.
    Background,
    /// The first, whatever its depth.
    Nearest,
}

/// Neighbours of a pixel, those at its sides first.
const NEIGHBOURS: [(isize, isize); 8] =
    [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];

/// Fills holes from their edges inward, a pixel a step: each takes colour and depth of a neighbour that was known a step
/// before, of equally good ones the left one, then right, above, below, and those at the corners in this order.
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
    let height = count / width;
    let beside = |pixel: usize, (dx, dy): (isize, isize)| {
        let (x, y) = ((pixel % width) as isize + dx, (pixel / width) as isize + dy);
        let inside = x >= 0 && y >= 0 && x < width as isize && y < height as isize;
        inside.then(|| y as usize * width + x as usize)
    };
    // The step after which a pixel is known; those that wait for the next are in `edge`.
    let mut known: Vec<u32> = hole.iter().map(|&hole| if hole { u32::MAX } else { 0 }).collect();
    let at_edge = |pixel: &usize| {
        hole[*pixel] && NEIGHBOURS.iter().any(|&n| beside(*pixel, n).is_some_and(|p| !hole[p]))
    };
    let mut edge: Vec<usize> = (0..count).filter(at_edge).collect();
    for &pixel in &edge {
        known[pixel] = 1;
    }
    let mut step = 1;
    while !edge.is_empty() {
        let mut next = Vec::new();
        for &pixel in &edge {
            let mut from: Option<usize> = None;
            for neighbour in NEIGHBOURS {
                let Some(other) = beside(pixel, neighbour) else { continue };
                if known[other] < step {
                    let better =
                        from.is_none_or(|from| method == Method::Background && depth[other] > depth[from]);
                    from = if better { Some(other) } else { from };
                } else if known[other] == u32::MAX {
                    known[other] = step + 1;
                    next.push(other);
                }
            }
            let from = from.expect("an edge has a known neighbour");
            (color[pixel], depth[pixel]) = (color[from], depth[from]);
        }
        edge = next;
        step += 1;
    }
    Ok(())
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
        for (method, colors) in [
            (Method::Nearest, [near, near, far, far, far]),
            (Method::Background, [near, near, far, far, far]),
        ] {
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

//! A picture with depth laid over another one (1998 dissertation, sections 1.4.1 and 4.4.3).
//!
//! Depth decides, pixel by pixel; where both are equally deep what is there stays. What a layer knows nothing of is a
//! *hole* only where something unknown may be nearer than what is there: where the pixel's ray comes into the space that
//! the layer stands for first.

use crate::error::Error;
use crate::render::BACKGROUND;
use crate::render::lanes::{InstructionSet, Kernel, Lanes};
use rayon::prelude::*;

/// What is there already, row-major, all of one size.
#[derive(Debug)]
pub struct Canvas<'a> {
    pub width: usize,
    pub color: &'a mut [[u8; 3]],
    /// Along the camera's axis; infinity where nothing is.
    pub depth: &'a mut [f32],
    /// The face of a pixel, or [`BACKGROUND`].
    pub ids: &'a mut [u32],
    pub hole: Option<&'a mut [bool]>,
    /// Which layer a pixel shows.
    pub label: &'a mut [i32],
}

/// What is laid over a rectangle of it, row-major, all of one size.
#[derive(Debug, Clone, Copy)]
pub struct Layer<'a> {
    pub width: usize,
    /// The canvas's row and column of its first pixel.
    pub at: [usize; 2],
    /// What is there stays if it is no deeper than this: of the layer itself, or of a window through which it is seen.
    /// Infinity where the layer has nothing.
    pub before: &'a [f32],
    /// Of what is shown.
    pub depth: &'a [f32],
    /// `before` and `depth` are in these units.
    pub scale: f32,
    /// What is there keeps its colour if there are none.
    pub color: Option<&'a [[u8; 3]]>,
    /// [`BACKGROUND`] if there are none.
    pub ids: Option<&'a [u32]>,
    /// What the canvas calls the layer's faces.
    pub names: Option<&'a [u32]>,
    /// Pixels of which the layer knows nothing.
    pub hole: Option<&'a [bool]>,
    /// Where the pixels' rays come into the space that the layer stands for: nothing of it is shown elsewhere, nor a hole.
    pub within: Option<&'a [bool]>,
    /// Faces that are in the layer, too: a layer hides them only by more than rounding.
    pub twice: Option<&'a [bool]>,
}

/// A layer shows a face that is drawn as well if it is nearer than this share of its depth: both have been rounded, to
/// different pixels.
pub const SAME: f32 = 0.995;

/// Lays a layer over a canvas; where it is shown the label is `label`. How many pixels that are.
///
/// # Errors
/// [`Error::Invalid`] for arrays that don't fit, or an id without a name.
pub fn lay(canvas: Canvas<'_>, layer: &Layer<'_>, label: i32) -> Result<usize, Error> {
    check(&canvas, layer)?;
    let [top, left] = layer.at;
    let (width, wide) = (layer.width, canvas.width);
    let rows = layer.depth.len() / width.max(1);
    if rows == 0 {
        return Ok(0);
    }
    let span = top * wide..(top + rows) * wide;
    let mut nothing = vec![];
    let hole = match canvas.hole {
        Some(hole) => &mut hole[span.clone()],
        None => {
            nothing.resize(span.len(), false);
            &mut nothing[..]
        }
    };
    let lines = canvas.color[span.clone()]
        .par_chunks_mut(wide)
        .zip(canvas.depth[span.clone()].par_chunks_mut(wide))
        .zip(canvas.ids[span.clone()].par_chunks_mut(wide))
        .zip(hole.par_chunks_mut(wide))
        .zip(canvas.label[span].par_chunks_mut(wide))
        .with_min_len(LEAST_ROWS);
    let counts = lines.enumerate().map(|(y, ((((color, depth), ids), hole), labels))| {
        let columns = left..left + width;
        let row = Row {
            color: &mut color[columns.clone()],
            depth: &mut depth[columns.clone()],
            ids: &mut ids[columns.clone()],
            hole: &mut hole[columns.clone()],
            label: &mut labels[columns],
        };
        row.lay(layer, y * width, label)
    });
    Ok(counts.sum())
}

/// Rows that one thread takes at least: fewer are done before another has woken.
const LEAST_ROWS: usize = 64;

fn check(canvas: &Canvas<'_>, layer: &Layer<'_>) -> Result<(), Error> {
    let invalid = |text: String| Err(Error::Invalid(text));
    let pixels = canvas.color.len();
    let hole = canvas.hole.as_ref().map_or(pixels, |hole| hole.len());
    let lengths = [canvas.depth.len(), canvas.ids.len(), hole, canvas.label.len()];
    if lengths != [pixels; 4] || canvas.width == 0 || !pixels.is_multiple_of(canvas.width) {
        return invalid(format!("the canvas has arrays of {pixels} and {lengths:?} pixels"));
    }
    let count = layer.depth.len();
    for (name, length) in [
        ("before", Some(layer.before.len())),
        ("color", layer.color.map(<[_]>::len)),
        ("ids", layer.ids.map(<[_]>::len)),
        ("hole", layer.hole.map(<[_]>::len)),
        ("within", layer.within.map(<[_]>::len)),
    ] {
        if let Some(length) = length.filter(|&length| length != count) {
            return invalid(format!("{name} has {length} pixels, depth {count}"));
        }
    }
    let rows = count.checked_div(layer.width).unwrap_or(0);
    let size = [pixels / canvas.width, canvas.width];
    if layer.at[0] + rows > size[0] || layer.at[1] + layer.width > size[1] {
        return invalid(format!(
            "a layer of {} x {rows} pixels at column {} and row {} is not inside of the canvas of {} x {}",
            layer.width, layer.at[1], layer.at[0], size[1], size[0]
        ));
    }
    if let (Some(ids), Some(names)) = (layer.ids, layer.names)
        && let Some((pixel, &id)) =
            ids.iter().enumerate().find(|&(_, &id)| id != BACKGROUND && id as usize >= names.len())
    {
        return invalid(format!("ids names face {id} at pixel {pixel}, there are {} names", names.len()));
    }
    Ok(())
}

/// A part of a row of the canvas.
struct Row<'a> {
    color: &'a mut [[u8; 3]],
    depth: &'a mut [f32],
    ids: &'a mut [u32],
    hole: &'a mut [bool],
    label: &'a mut [i32],
}

impl Row<'_> {
    /// Lays the layer's pixels from `first` on over it.
    fn lay(self, layer: &Layer<'_>, first: usize, label: i32) -> usize {
        let mut count = 0;
        for x in 0..self.depth.len() {
            let from = first + x;
            let unknown = layer.hole.is_some_and(|hole| hole[from]);
            if layer.within.is_some_and(|within| !within[from]) {
                continue;
            }
            let there = self.depth[x];
            let drawn_twice =
                layer.twice.is_some_and(|twice| twice.get(self.ids[x] as usize).copied().unwrap_or(false));
            let limit = if drawn_twice { there * SAME } else { there };
            if layer.before[from] * layer.scale < limit {
                if let Some(color) = layer.color {
                    self.color[x] = color[from];
                }
                self.depth[x] = layer.depth[from] * layer.scale;
                self.ids[x] = match (layer.ids.map_or(BACKGROUND, |ids| ids[from]), layer.names) {
                    (id, Some(names)) if id != BACKGROUND => names[id as usize],
                    (id, _) => id,
                };
                self.hole[x] = unknown;
                self.label[x] = label;
                count += 1;
            } else if layer.within.is_some() {
                self.hole[x] |= unknown;
            }
        }
        count
    }
}

/// A half-space as the rays of an image meet it: of the point at depth t on the ray through pixel coordinates (x, y),
/// `start + t (slope[0] x + slope[1] y + slope[2])` is not negative inside.
#[derive(Debug, Clone, Copy)]
pub struct Side {
    pub slope: [f64; 3],
    pub start: f64,
}

/// Where the rays through pixel centres come into a convex space beyond a depth `near`, and before what is seen.
///
/// How many pixels that are.
///
/// # Errors
/// [`Error::Invalid`] for arrays of other sizes.
pub fn enters(
    sides: &[Side],
    near: f64,
    depth: &[f32],
    width: usize,
    within: &mut [bool],
) -> Result<usize, Error> {
    if depth.len() != within.len() || width == 0 {
        return Err(Error::Invalid(format!(
            "within has {} pixels, depth {} in rows of {width}",
            within.len(),
            depth.len()
        )));
    }
    let lines = within.par_chunks_mut(width).zip(depth.par_chunks(width)).with_min_len(LEAST_ROWS);
    let counts = lines
        .enumerate()
        .map(|(y, (within, depth))| InstructionSet::best().run(Entering { sides, near, y, depth, within }));
    Ok(counts.sum())
}

/// A row of pixels whose rays may enter.
///
/// At depth t, times 1 / t, a side is `start / t + slope`: a bound on 1 / t that is linear along a row. So the least 1 / t
/// and the greatest inside are found without dividing, several pixels at a time.
struct Entering<'a> {
    sides: &'a [Side],
    near: f64,
    y: usize,
    depth: &'a [f32],
    within: &'a mut [bool],
}

/// Pixels of a row that are looked at together.
const PIECE: usize = 16;

impl Kernel for Entering<'_> {
    type Output = usize;

    #[inline(always)]
    fn run<L: Lanes>(self) -> usize {
        let Self { sides, near, y, depth, within } = self;
        let mut count = 0;
        for (piece, (within, depth)) in within.chunks_mut(PIECE).zip(depth.chunks(PIECE)).enumerate() {
            if depth.iter().all(|&depth| f64::from(depth) <= near) {
                within.fill(false);
                continue;
            }
            // The nearest and the farthest point inside, as 1 / depth.
            let (mut nearest, mut farthest) = ([1.0 / near; PIECE], [0.0_f64; PIECE]);
            for side in sides {
                let row = side.slope[1] * (y as f64 + 0.5) + side.slope[2];
                let (first, step) = (row + side.slope[0] * ((piece * PIECE) as f64 + 0.5), side.slope[0]);
                if side.start == 0.0 {
                    for (x, nearest) in nearest.iter_mut().enumerate() {
                        *nearest = if first + step * (x as f64) < 0.0 { 0.0 } else { *nearest };
                    }
                    continue;
                }
                let scale = -1.0 / side.start;
                let (first, step) = (first * scale, step * scale);
                if side.start < 0.0 {
                    for (x, nearest) in nearest.iter_mut().enumerate() {
                        let at = first + step * x as f64;
                        *nearest = if at < *nearest { at } else { *nearest };
                    }
                } else {
                    for (x, farthest) in farthest.iter_mut().enumerate() {
                        let at = first + step * x as f64;
                        *farthest = if at > *farthest { at } else { *farthest };
                    }
                }
            }
            for (x, (within, &depth)) in within.iter_mut().zip(depth).enumerate() {
                *within = farthest[x] <= nearest[x] && nearest[x] > 1.0 / f64::from(depth);
                count += usize::from(*within);
            }
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_stays_where_both_are_equally_deep() {
        let (mut color, mut depth) = (vec![[1; 3]; 3], vec![2.0_f32, 2.0, f32::INFINITY]);
        let (mut ids, mut label) = (vec![7, 7, BACKGROUND], vec![0; 3]);
        let canvas = Canvas {
            width: 3,
            color: &mut color,
            depth: &mut depth,
            ids: &mut ids,
            hole: None,
            label: &mut label,
        };
        let over = [2.0, 1.0, f32::INFINITY];
        let layer = Layer {
            width: 3,
            at: [0, 0],
            before: &over,
            depth: &over,
            scale: 1.0,
            color: Some(&[[9; 3]; 3]),
            ids: None,
            names: None,
            hole: None,
            within: None,
            twice: None,
        };
        assert_eq!(lay(canvas, &layer, 5).unwrap(), 1);
        assert_eq!((label, ids), (vec![0, 5, 0], vec![7, BACKGROUND, BACKGROUND]));
        assert_eq!(color, [[1; 3], [9; 3], [1; 3]]);
    }
}

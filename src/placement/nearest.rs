//! The cells that come nearest to an eye, as many as a number of faces allows.

use crate::error::Error;
use glam::DVec3;

/// Cells of faces side by side.
#[derive(Debug, Clone, Copy)]
pub struct Boxes<'a> {
    /// Lowest and highest coordinates of the faces of each.
    pub low: &'a [[f64; 3]],
    pub high: &'a [[f64; 3]],
    /// Places in `order` at which the faces of each start, and the end.
    pub starts: &'a [i64],
    pub order: &'a [u32],
}

/// An eye and what it sees.
#[derive(Debug, Clone, Copy)]
pub struct Gaze {
    pub eye: DVec3,
    /// Unit vector.
    pub ahead: DVec3,
    /// Normals of the pyramid's sides, inward.
    pub sides: [DVec3; 4],
}

/// Those of some cells that are not wholly outside of one side of a gaze's pyramid, nearest first, as long as all their
/// faces fit in `room`: the faces are appended. The depth at which the first begins that doesn't fit, or infinity.
///
/// Equally near cells come in the order in which they are named.
///
/// # Errors
/// [`Error::Invalid`] if a cell is named that is not there, or arrays don't fit.
pub fn nearest(
    boxes: Boxes<'_>,
    cells: &[i64],
    gaze: &Gaze,
    room: usize,
    faces: &mut Vec<u32>,
) -> Result<f64, Error> {
    let count = boxes.low.len();
    let ascending = boxes.starts.windows(2).all(|pair| pair[0] <= pair[1]);
    let last = boxes.starts.last().copied().unwrap_or(-1);
    if boxes.high.len() != count
        || boxes.starts.len() != count + 1
        || !ascending
        || boxes.starts[0] < 0
        || last as usize != boxes.order.len()
    {
        return Err(Error::Invalid(format!(
            "{count} lowest and {} highest corners of cells, {} starts up to {last} for {} faces",
            boxes.high.len(),
            boxes.starts.len(),
            boxes.order.len()
        )));
    }
    let mut seen = Vec::new();
    for (index, &cell) in cells.iter().enumerate() {
        if cell < 0 || cell as usize >= count {
            return Err(Error::Invalid(format!("cells[{index}] is {cell}, there are {count}")));
        }
        let (low, high) =
            (DVec3::from_array(boxes.low[cell as usize]), DVec3::from_array(boxes.high[cell as usize]));
        let (middle, half) = (0.5 * (low + high) - gaze.eye, 0.5 * (high - low));
        let (along, reach) = (middle.dot(gaze.ahead), half.dot(gaze.ahead.abs()));
        let reaches_in = |side: &DVec3| middle.dot(*side) + half.dot(side.abs()) >= 0.0;
        if along + reach > 0.0 && gaze.sides.iter().all(reaches_in) {
            seen.push(((along - reach).max(0.0), index, cell as usize));
        }
    }
    seen.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut left = room;
    for &(depth, _, cell) in &seen {
        let own = boxes.starts[cell] as usize..boxes.starts[cell + 1] as usize;
        if own.len() > left {
            return Ok(depth);
        }
        left -= own.len();
        faces.extend_from_slice(&boxes.order[own]);
    }
    Ok(f64::INFINITY)
}

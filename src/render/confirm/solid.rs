//! Where a picture shows surfaces without gaps.
//!
//! A face behind all the samples around it may still show between them. It hardly can where the samples' depths run on
//! smoothly: there they are of one surface, or of several that touch. Elsewhere (leaves, pipes, silhouettes) the
//! picture alone decides nothing.

use crate::camera::Projection;
use crate::mesh::REACH;
use crate::render::frame::{Band, FACE_BITS, Frame, TILE};
use crate::render::lanes::{InstructionSet, Kernel, Lanes};
use crate::render::pyramid::{PixelBox, Pyramid};
use crate::render::triangle::DROPPED;
use crate::render::view::View;

/// The tangent of the steepest slope, against the image's plane, that still counts as one surface.
const STEEPEST: f64 = 4.0;

/// Boxes of up to this many samples are read sample by sample where their tiles are not solid.
const SMALL_BOX: usize = 64;

/// The tiles of a frame in which neighbouring samples, those across the tile's lower and right edges among them, are
/// no farther apart in depth than on one surface.
#[derive(Debug, Default)]
pub struct Solid {
    columns: usize,
    tiles: Vec<bool>,
    /// The largest difference of two neighbouring words on a surface.
    step: u64,
}

impl Solid {
    /// Reads a frame. O(samples).
    pub fn fill(&mut self, view: &View, frame: &Frame) {
        // A relative step in depth is as large a step of a key, to a factor of two.
        let pixel = 1.0 / view.focal();
        let relative = match view.projection {
            Projection::Perspective => STEEPEST * pixel,
            Projection::Orthographic => STEEPEST * pixel / (view.distance.abs() + REACH),
        };
        let mantissa = (1_u64 << (52 - DROPPED)) as f64;
        self.step = ((relative * mantissa) as u64) << FACE_BITS;
        self.columns = frame.width.div_ceil(TILE);
        InstructionSet::best().run(Fill { solid: self, frame });
    }

    /// Whether what lies behind `word` in a box is hidden by the picture.
    ///
    /// `area` holds the samples in and around the thing; `pyramid` is of the same frame.
    pub fn hides(
        &self,
        pyramid: &mut Pyramid,
        band: &Band<'_>,
        view: &View,
        area: &PixelBox,
        word: u64,
    ) -> bool {
        if in_border(area.x.start, area.x.end, view.width) || in_border(area.y.start, area.y.end, view.height)
        {
            return false;
        }
        let rows = area.y.start / TILE..(area.y.end - 1) / TILE + 1;
        let columns = area.x.start / TILE..(area.x.end - 1) / TILE + 1;
        let solid = rows
            .into_iter()
            .all(|row| self.tiles[row * self.columns..][columns.clone()].iter().all(|&solid| solid));
        if solid {
            pyramid.all_greater(band, area, word) || self.hides_closely(band, area, word)
        } else {
            self.hides_closely(band, area, word)
        }
    }

    /// [`hides`](Self::hides), sample by sample, where there are few.
    fn hides_closely(&self, band: &Band<'_>, area: &PixelBox, word: u64) -> bool {
        if area.x.len() * area.y.len() > SMALL_BOX {
            return false;
        }
        let mut above: &[u64] = &[];
        for y in area.y.clone() {
            let line = &band.samples[y * band.stride..][area.x.clone()];
            let mut last = line[0];
            for (x, &sample) in line.iter().enumerate() {
                let over = above.get(x).copied().unwrap_or(sample);
                if sample <= word || sample.abs_diff(last) > self.step || sample.abs_diff(over) > self.step {
                    return false;
                }
                last = sample;
            }
            above = line;
        }
        true
    }

    /// Whether a tile is solid.
    pub fn is_solid(&self, column: usize, row: usize) -> bool {
        self.tiles[row * self.columns + column]
    }
}

/// Whether part of a range of samples may lie outside the outermost samples and little of it between them: of what
/// is in the strip along the image's border the picture shows one side only.
fn in_border(start: usize, end: usize, size: usize) -> bool {
    (start == 0 || end == size) && end - start <= 2
}

/// [`Solid::fill`] as a kernel: plain loops, vectorised with what the processor has.
struct Fill<'a> {
    solid: &'a mut Solid,
    frame: &'a Frame,
}

impl Kernel for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { solid, frame } = self;
        let step = solid.step;
        solid.tiles.clear();
        for top in (0..frame.height).step_by(TILE) {
            let bottom = (top + TILE).min(frame.height);
            for left in (0..frame.width).step_by(TILE) {
                let mut largest = [0_u64; TILE];
                let right = (left + TILE).min(frame.width);
                if right + 1 < frame.width {
                    for y in top..bottom {
                        let row = &frame.row(y)[left..left + TILE + 1];
                        let below = &frame.row((y + 1).min(frame.height - 1))[left..left + TILE];
                        for x in 0..TILE {
                            let across = row[x].abs_diff(row[x + 1]).max(row[x].abs_diff(below[x]));
                            largest[x] = largest[x].max(across);
                        }
                    }
                } else {
                    for y in top..bottom {
                        let row = frame.row(y);
                        let below = frame.row((y + 1).min(frame.height - 1));
                        for x in left..right {
                            let next = row[(x + 1).min(frame.width - 1)];
                            let across = row[x].abs_diff(next).max(row[x].abs_diff(below[x]));
                            largest[x - left] = largest[x - left].max(across);
                        }
                    }
                }
                solid.tiles.push(largest.iter().all(|&largest| largest <= step));
            }
        }
    }
}

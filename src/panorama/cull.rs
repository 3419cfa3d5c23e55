//! Tiles that no eye on the track beside a viewpoint can see (2003 paper, section 4).
//!
//! Slabs are taken front to back; an occlusion map holds what of the nearer ones is kept. The paper's test is
//! [`Method::Paper`]: it slides a window over the map's opacity. It loses what it shouldn't: it takes occluders to lie at
//! their slab's far end, though near ones move most, and moves the window sideways only.
//!
//! [`Method::Exact`] asks for each pixel of a tile whether it is hidden from all eyes on a straight way from the viewpoint.
//! In the half-plane through the way and the point, each slab is a curve around the viewpoint, cut where its surfaces end.
//! A stretch that is one surface hides the point from all eyes between the first and the last of those that its own points
//! lie before: it is connected, so its shadow on the way, cast by the point, is. The point is hidden if such shadows leave
//! nothing of the way free. A point of the curve at disparity `q`, towards `d + k e` (`d` the point's direction, `e` the
//! way), casts its shadow at the share `k / (q |d + k e| - own)` of the way. How far that is to walk is the paper's
//! `b (1 / h1 - 1 / h2)` with each occluder's own depth in the place of `h1`, and it goes along the epipolar line, up and
//! down as well as sideways. Each slab casts its own shadows, so a far wall goes on behind the near one that ends, and the
//! point's own slab does, too: of dropped tiles as well, since the first surface that a ray meets is never dropped.

use super::links::{DOWN, RIGHT, links};
use super::projection::Projection;
use crate::control::Control;
use crate::error::Error;
use glam::DVec3;
use rayon::prelude::*;

/// How a tile is found to be hidden.
#[derive(Debug, Clone)]
pub enum Method {
    /// Nothing is lost at alpha 1, but for pixels that the quads' stated error moves.
    Exact {
        /// A gap of so much disparity between neighbours is closed: see [`links`].
        step: f32,
        /// How far, in disparity, surfaces may be from where they are drawn.
        slack: f32,
    },
    /// The paper's equations (1) to (5).
    Paper {
        /// The range that each slab ends at: where its occluders are taken to be.
        ends: Vec<f64>,
        /// Takes an occludee's smallest range, as the paper's text does, rather than its largest, as its figure 4.
        smallest: bool,
    },
}

/// Steps of the walk over the slabs, in pixels.
const STRIDE: f64 = 0.7;

/// A hidden tile's pixels are looked at in two rounds: the first one, of every so many columns and rows, finds most tiles
/// that are seen.
const SPARSE: usize = 5;

/// How far beyond the middle of its first or last row the walk may go, in pixels: what roundings do.
const EDGE: f64 = 1e-6;

/// A stretch that has no shadow: where it begins and ends.
const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

/// Disparities that differ by so small a share are the same surface, rendered in two slabs.
const SAME: f32 = 1e-4;

/// Which tiles of each slab to keep, rows of tiles first: those that have something in them and are not hidden by a share
/// of `alpha` or more.
///
/// `slabs` are disparities, 0 where transparent, nearest slab first. `eyes` are where the straight ways end, from the
/// viewpoint: the neighbouring viewpoints, and points between where the track bends.
///
/// # Errors
/// [`Error::Invalid`] if a size doesn't fit, [`Error::Interrupted`].
pub fn kept(
    projection: &Projection,
    slabs: &[&[f32]],
    tile: usize,
    eyes: &[DVec3],
    method: &Method,
    alpha: f64,
    control: &Control,
) -> Result<Vec<Vec<bool>>, Error> {
    let (width, height) = (projection.width, projection.height);
    if let Some(slab) = slabs.iter().position(|slab| slab.len() != width * height) {
        return Err(Error::Invalid(format!("slab {slab} must have {width} x {height} pixels")));
    }
    if tile == 0 || !width.is_multiple_of(tile) || !height.is_multiple_of(tile) {
        return Err(Error::Invalid(format!("tile must divide the size, got {tile} for {width} x {height}")));
    }
    if let Method::Paper { ends, .. } = method
        && ends.len() != slabs.len()
    {
        return Err(Error::Invalid(format!("{} slabs have {} ends", slabs.len(), ends.len())));
    }
    let across = width / tile;
    let mut covered = vec![false; width * height];
    let mut surfaces: Vec<Vec<f32>> = Vec::new();
    let mut all = Vec::new();
    for (index, &slab) in slabs.iter().enumerate() {
        if let Method::Exact { step, .. } = method {
            surfaces.push(surface(slab, width, *step));
        }
        let nearest = f64::from(surfaces.iter().flatten().fold(0.0, |most, &q| q.max(most)));
        let keep = (0..across * (height / tile))
            .into_par_iter()
            .map(|number| {
                control.step(1)?;
                let tile = Tile { x: number % across * tile, y: number / across * tile, side: tile };
                if tile.pixels(width).all(|(_, _, i)| slab[i] == 0.0) {
                    return Ok(false);
                }
                Ok(index == 0
                    || match method {
                        Method::Exact { slack, .. } => {
                            let scene = Occluders {
                                projection,
                                surfaces: &surfaces,
                                slack: f64::from(*slack),
                                nearest,
                            };
                            !scene.hide(slab, &tile, eyes, alpha)
                        }
                        Method::Paper { ends, smallest } => {
                            let window = window(projection, slab, &tile, eyes, ends[index - 1], *smallest);
                            mean(&covered, projection, &tile, window) < alpha
                        }
                    })
            })
            .collect::<Result<Vec<bool>, Error>>()?;
        let keeps = |i: usize| keep[i / width / tile * across + i % width / tile];
        match method {
            // What alpha drops without its being hidden is no occluder.
            Method::Exact { .. } => {
                for (i, q) in surfaces[index].iter_mut().enumerate() {
                    if !keeps(i) {
                        *q = 0.0;
                    }
                }
            }
            Method::Paper { .. } => {
                for (i, covered) in covered.iter_mut().enumerate() {
                    *covered |= slab[i] > 0.0 && keeps(i);
                }
            }
        }
        all.push(keep);
    }
    Ok(all)
}

/// A square of pixels.
struct Tile {
    x: usize,
    y: usize,
    side: usize,
}

impl Tile {
    /// Column, row and index of each pixel.
    fn pixels(&self, width: usize) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        (self.y..self.y + self.side)
            .flat_map(move |y| (self.x..self.x + self.side).map(move |x| (x, y, y * width + x)))
    }
}

/// A slab's disparities where a pixel is one surface with all around it, 0 elsewhere.
fn surface(slab: &[f32], width: usize, step: f32) -> Vec<f32> {
    let links = links(slab, width, step);
    let height = slab.len() / width;
    let mut surface = vec![0.0; slab.len()];
    surface.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        // The first and the last row have nothing beyond them that could be cut off.
        let (top, bottom) = (y.saturating_sub(1), (y + 1).min(height - 1));
        for (x, q) in row.iter_mut().enumerate() {
            let (left, right) = ((x + width - 1) % width, (x + 1) % width);
            let linked = |x: usize, y: usize, flag: u8| links[y * width + x] & flag != 0;
            if (top..=bottom).all(|y| linked(left, y, RIGHT) && linked(x, y, RIGHT))
                && [left, x, right].iter().all(|&x| (top..bottom).all(|y| linked(x, y, DOWN)))
            {
                *q = slab[y * width + x];
            }
        }
    });
    surface
}

/// The surfaces that may hide a slab's tiles: those of the slabs in front, and its own.
struct Occluders<'a> {
    projection: &'a Projection,
    surfaces: &'a [Vec<f32>],
    slack: f64,
    /// The greatest disparity of them.
    nearest: f64,
}

impl Occluders<'_> {
    /// Whether so large a share of a tile's opaque pixels is hidden from all eyes.
    fn hide(&self, slab: &[f32], tile: &Tile, eyes: &[DVec3], alpha: f64) -> bool {
        let width = self.projection.width;
        let opaque = tile.pixels(width).filter(|&(_, _, i)| slab[i] > 0.0).count();
        let most = ((1.0 - alpha) * opaque as f64 + 1e-9).floor() as usize;
        let mut stretches = vec![[0.0; 2]; self.surfaces.len()];
        let mut seen = 0;
        for sparse in [true, false] {
            for (x, y, i) in tile.pixels(width).filter(|&(_, _, i)| slab[i] > 0.0) {
                if sparse != (x % SPARSE == 0 && y % SPARSE == 0) {
                    continue;
                }
                let direction = self.projection.through(x, y);
                if !eyes.iter().all(|&eye| self.hide_point(direction, slab[i], i, eye, &mut stretches)) {
                    seen += 1;
                    if seen > most {
                        return false;
                    }
                }
            }
        }
        true
    }

    /// The share of the way that no shadow cast from so far `along` on, or farther, can begin before. The share grows with
    /// `along` for as long as the nearest surface stays near, and tends to a limit.
    fn first_shadow(&self, along: f64, away: f64, own: f64, length: f64) -> f64 {
        let nearest = self.nearest + self.slack;
        let here = nearest * away - own;
        let limit = 1.0 / (nearest * length);
        if here > 0.0 { limit.min(along / here) } else { limit }
    }

    /// Whether a point is hidden from all eyes on the way to `eye`.
    fn hide_point(
        &self,
        direction: DVec3,
        disparity: f32,
        pixel: usize,
        eye: DVec3,
        stretches: &mut [[f64; 2]],
    ) -> bool {
        let Self { projection, surfaces, slack, .. } = *self;
        let own = f64::from(disparity);
        let (before, same) = surfaces[..surfaces.len() - 1].iter().map(|surface| surface[pixel]).fold(
            (false, false),
            |(before, same), q| {
                (before || f64::from(q) > own + slack, same || (q - disparity).abs() <= SAME * disparity)
            },
        );
        if same || !before {
            return same;
        }
        let length = eye.length();
        if length == 0.0 {
            return true;
        }
        let turn = direction.cross(eye).length();
        let bottom = projection.height as f64 - 0.5 + EDGE;
        stretches.fill(NOTHING);
        // The way is hidden up to here.
        let mut hidden = 0.0_f64;
        let mut along = 0.0_f64;
        for _ in 0..projection.width {
            let toward = direction + eye * along;
            let away = toward.length();
            if away.is_nan() || away <= 1e-9 {
                return false;
            }
            let at = projection.place(toward);
            if at[1] < 0.5 - EDGE || at[1] > bottom {
                return false;
            }
            let i = (at[1] as usize).min(projection.height - 1) * projection.width
                + at[0].max(0.0) as usize % projection.width;
            let mut nearest = own;
            for (surface, stretch) in surfaces.iter().zip(stretches.iter_mut()) {
                let q = f64::from(surface[i]);
                if q == 0.0 {
                    *stretch = NOTHING;
                    continue;
                }
                nearest = nearest.max(q);
                let (early, late) = ((q + slack) * away - own, (q - slack) * away - own);
                if late > 0.0 {
                    stretch[0] = stretch[0].min(along / late);
                }
                // Past the point, its shadow is beyond all eyes.
                stretch[1] = stretch[1].max(if early > 0.0 { along / early } else { f64::INFINITY });
                if stretch[0] <= hidden {
                    hidden = hidden.max(stretch[1]);
                }
            }
            if hidden >= 1.0 {
                return true;
            }
            if stretches.iter().all(|stretch| stretch[0] > hidden)
                && hidden < self.first_shadow(along, away, own, length)
            {
                return false;
            }
            let density = projection.density(toward / away);
            let stride = STRIDE * away * away / (density * turn).max(1e-300);
            // Where the eye goes straight at the point the place doesn't change, and the surface there is passed.
            along += stride.min(nearest);
        }
        false
    }
}

/// The share of a tile, widened by columns to its left and right, that is covered.
fn mean(covered: &[bool], projection: &Projection, tile: &Tile, [left, right]: [usize; 2]) -> f64 {
    let width = projection.width;
    let columns = (tile.side + left + right).min(width);
    let start = tile.x + width - left % width;
    let count = (tile.y..tile.y + tile.side)
        .map(|y| (start..start + columns).filter(|x| covered[y * width + x % width]).count())
        .sum::<usize>();
    count as f64 / (columns * tile.side) as f64
}

/// Columns by which a tile's projection is extended to the left and right: `s1` and `s2` of equation (1), in pixels.
///
/// `d21` of equations (2) to (5) is how far a neighbour lies to the side, seen from the tile. Equation (1) is a length on
/// the plane at the occluders' end `h1`, so the focal length over `h1` makes it pixels: `f d (1 / h1 - 1 / h2)`.
fn window(
    projection: &Projection,
    slab: &[f32],
    tile: &Tile,
    eyes: &[DVec3],
    end: f64,
    smallest: bool,
) -> [usize; 2] {
    let opaque = tile.pixels(projection.width).map(|(_, _, i)| slab[i]).filter(|&q| q > 0.0);
    let disparity =
        f64::from(if smallest { opaque.fold(0.0, f32::max) } else { opaque.fold(f32::MAX, f32::min) });
    let (x, y) = (tile.x + tile.side / 2, tile.y + tile.side / 2);
    let turned = projection.corner(x + 1, y) - projection.corner(x, y);
    let side = turned.normalize_or_zero();
    let mut window = [0.0_f64; 2];
    for eye in eyes {
        let moved = eye.dot(side);
        let extent = projection.focal() * moved.abs() * (1.0 / end - disparity).max(0.0);
        let right = usize::from(moved > 0.0);
        window[right] = window[right].max(extent);
    }
    window.map(|extent| extent.ceil() as usize)
}

#[cfg(test)]
mod tests {
    use super::super::projection::Kind;
    use super::*;
    use glam::{DMat3, dvec3};

    /// A wall at range 2 over some columns, and something at range 8 behind all of it.
    fn wall(columns: std::ops::Range<usize>) -> (Projection, Vec<f32>, Vec<f32>) {
        let panorama = Projection::new(Kind::Cylinder, 256, 64, DMat3::IDENTITY).unwrap();
        let near = (0..256 * 64).map(|i| if columns.contains(&(i % 256)) { 0.5 } else { 0.0 }).collect();
        (panorama, near, vec![0.125; 256 * 64])
    }

    fn dropped(method: &Method, eyes: &[DVec3]) -> usize {
        let (panorama, near, far) = wall(64..192);
        let slabs = [near.as_slice(), far.as_slice()];
        let keep = kept(&panorama, &slabs, 8, eyes, method, 1.0, &Control::default()).unwrap();
        assert_eq!(keep[0].iter().filter(|&&keep| keep).count(), 16 * 8);
        keep[1].iter().filter(|&&keep| !keep).count()
    }

    #[test]
    fn a_wall_hides_less_the_farther_the_eye_goes() {
        let exact = Method::Exact { step: 0.01, slack: 0.0 };
        let paper = Method::Paper { ends: vec![4.0, 10.0], smallest: false };
        let near = [dvec3(0.1, 0.0, 0.0), dvec3(-0.1, 0.0, 0.0)];
        let far = near.map(|eye| eye * 8.0);
        // Tiles at the wall's ends are kept, and in the first and last row those of which the line to an eye leaves the panorama.
        assert!((14 * 6..14 * 8).contains(&dropped(&exact, &near)), "{}", dropped(&exact, &near));
        assert!(dropped(&exact, &far) < dropped(&exact, &near));
        assert_eq!(dropped(&paper, &[]), 16 * 8);
        // The paper takes the wall to be at 4, where it moves half as far.
        assert!(dropped(&paper, &far) > dropped(&exact, &far));
    }

    #[test]
    fn a_cut_in_the_wall_lets_an_eye_through() {
        let (panorama, mut near, far) = wall(0..256);
        for row in near.chunks_mut(256) {
            row[128] = 0.45;
        }
        let slabs = [near.as_slice(), far.as_slice()];
        let eyes = [dvec3(0.5, 0.0, 0.0)];
        let exact = Method::Exact { step: 0.01, slack: 0.0 };
        let keep = kept(&panorama, &slabs, 8, &eyes, &exact, 1.0, &Control::default()).unwrap();
        let row = &keep[1][4 * 32..5 * 32];
        assert!(row[16] && !row[4] && !row[30], "{row:?}");
    }
}

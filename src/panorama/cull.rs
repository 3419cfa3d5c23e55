//! Tiles that no eye on the track beside a viewpoint can see (2003 paper, section 4).
//!
//! Slabs are taken front to back; an occlusion map holds what of the nearer ones is kept. The paper's test is
//! [`Method::Paper`]: it slides a window over the map's opacity. It loses what it shouldn't: it takes occluders to lie at
//! their slab's far end, though near ones move most, and moves the window sideways only.
//!
//! [`Method::Exact`] asks for each pixel of a tile whether it is hidden from all eyes on a straight way from the viewpoint.
//! In the half-plane through the way and the point, the map is a curve around the viewpoint. The point is hidden if a
//! stretch of that curve which is one surface crosses the triangle of the way and the point: it begins nearer than the
//! point on the viewpoint's own ray, and gets behind the line from the point to the way's other end before it is cut
//! anywhere. Every eye's ray then meets it. How far that is to walk in the map is the paper's
//! `b (1 / h1 - 1 / h2)` with each occluder's own depth in the place of `h1`, and it goes along the epipolar line, up and down
//! as well as sideways. Surfaces that hide a point only together are not found: what is kept may still be unseen.

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
    },
    /// The paper's equations (1) to (5).
    Paper {
        /// The range that each slab ends at: where its occluders are taken to be.
        ends: Vec<f64>,
        /// Takes an occludee's smallest range, as the paper's text does, rather than its largest, as its figure 4.
        smallest: bool,
    },
}

/// Steps of the walk over the map, in pixels.
const STRIDE: f64 = 0.7;

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
    let mut map = Map::new(width, height);
    let across = width / tile;
    let mut all = Vec::new();
    for (index, &slab) in slabs.iter().enumerate() {
        map.find_solid();
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
                        Method::Exact { .. } => !hidden(projection, &map, slab, &tile, eyes, alpha),
                        Method::Paper { ends, smallest } => {
                            let window = window(projection, slab, &tile, eyes, ends[index - 1], *smallest);
                            map.mean(&tile, window) < alpha
                        }
                    })
            })
            .collect::<Result<Vec<bool>, Error>>()?;
        let step = match method {
            Method::Exact { step } => Some(*step),
            Method::Paper { .. } => None,
        };
        map.add(slab, &keep, tile, step);
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

/// What is kept of the slabs in front, as the viewpoint sees it.
struct Map {
    width: usize,
    height: usize,
    /// 0 where nothing is yet.
    disparity: Vec<f32>,
    links: Vec<u8>,
    /// Pixels that are one surface with all eight around them.
    solid: Vec<bool>,
}

impl Map {
    fn new(width: usize, height: usize) -> Self {
        let pixels = width * height;
        Self {
            width,
            height,
            disparity: vec![0.0; pixels],
            links: vec![0; pixels],
            solid: vec![false; pixels],
        }
    }

    /// Adds the kept tiles of a slab behind what is there; with their links if gaps of `step` are closed.
    fn add(&mut self, slab: &[f32], keep: &[bool], tile: usize, step: Option<f32>) {
        let across = self.width / tile;
        let keeps = |i: usize| keep[i / self.width / tile * across + i % self.width / tile];
        for (i, &q) in slab.iter().enumerate() {
            if self.disparity[i] == 0.0 && q > 0.0 && keeps(i) {
                self.disparity[i] = q;
            }
        }
        let Some(step) = step else { return };
        let own = |i: usize| {
            slab[i] > 0.0 && keeps(i) && (slab[i] - self.disparity[i]).abs() <= SAME * self.disparity[i]
        };
        for (i, flags) in links(slab, self.width, step).into_iter().enumerate() {
            if flags == 0 || !own(i) {
                continue;
            }
            let right = i - i % self.width + (i + 1) % self.width;
            if flags & RIGHT != 0 && own(right) {
                self.links[i] |= RIGHT;
            }
            if flags & DOWN != 0 && own(i + self.width) {
                self.links[i] |= DOWN;
            }
        }
    }

    fn find_solid(&mut self) {
        let (width, height, links) = (self.width, self.height, &self.links);
        self.solid.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            if y == 0 || y + 1 == height {
                row.fill(false);
                return;
            }
            for (x, solid) in row.iter_mut().enumerate() {
                let (left, right) = ((x + width - 1) % width, (x + 1) % width);
                let linked = |x: usize, y: usize, flag: u8| links[y * width + x] & flag != 0;
                *solid = (y - 1..=y + 1).all(|y| linked(left, y, RIGHT) && linked(x, y, RIGHT))
                    && [left, x, right].iter().all(|&x| linked(x, y - 1, DOWN) && linked(x, y, DOWN));
            }
        });
    }

    /// The share of a tile, widened by columns to its left and right, that is covered.
    fn mean(&self, tile: &Tile, [left, right]: [usize; 2]) -> f64 {
        let columns = (tile.side + left + right).min(self.width);
        let start = tile.x + self.width - left % self.width;
        let covered = (tile.y..tile.y + tile.side)
            .map(|y| {
                let row = &self.disparity[y * self.width..][..self.width];
                (start..start + columns).filter(|x| row[x % self.width] > 0.0).count()
            })
            .sum::<usize>();
        covered as f64 / (columns * tile.side) as f64
    }
}

/// Whether so large a share of a tile's opaque pixels is hidden from all eyes.
fn hidden(projection: &Projection, map: &Map, slab: &[f32], tile: &Tile, eyes: &[DVec3], alpha: f64) -> bool {
    let opaque = tile.pixels(map.width).filter(|&(_, _, i)| slab[i] > 0.0).count();
    let most = ((1.0 - alpha) * opaque as f64 + 1e-9).floor() as usize;
    let mut seen = 0;
    for (x, y, i) in tile.pixels(map.width).filter(|&(_, _, i)| slab[i] > 0.0) {
        let direction = projection.through(x, y);
        if !eyes.iter().all(|&eye| is_hidden(projection, map, direction, slab[i], i, eye)) {
            seen += 1;
            if seen > most {
                return false;
            }
        }
    }
    true
}

/// Whether a point is hidden from all eyes on the way to `eye`.
fn is_hidden(
    projection: &Projection,
    map: &Map,
    direction: DVec3,
    disparity: f32,
    pixel: usize,
    eye: DVec3,
) -> bool {
    if !map.solid[pixel] || map.disparity[pixel] < disparity * (1.0 - SAME) {
        return false;
    }
    let own = f64::from(disparity);
    let turn = direction.cross(eye).length();
    // The line from the point to the eye, from the viewpoint: `direction + along * eye`, at disparity
    // `(own + along) / |direction + along * eye|`.
    let mut along = 0.0;
    loop {
        let toward = direction + eye * along;
        let length = toward.length();
        if length.is_nan() || length <= 1e-9 {
            return false;
        }
        let at = projection.place(toward);
        if at[1] < 0.0 || at[1] >= map.height as f64 {
            return false;
        }
        let i = at[1] as usize * map.width + at[0].max(0.0) as usize % map.width;
        if !map.solid[i] {
            return false;
        }
        if along > 0.0 && f64::from(map.disparity[i]) <= (own + along) / length {
            return true;
        }
        let density = projection.density(toward / length);
        let stride = STRIDE * length * length / (density * turn).max(1e-300);
        // Where the eye goes straight at the point the place doesn't change, and the surface there is passed.
        along += stride.min(f64::from(map.disparity[i]).max(own));
    }
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
        let exact = Method::Exact { step: 0.01 };
        let paper = Method::Paper { ends: vec![4.0, 10.0], smallest: false };
        let near = [dvec3(0.1, 0.0, 0.0), dvec3(-0.1, 0.0, 0.0)];
        let far = near.map(|eye| eye * 8.0);
        // Rows at the top and bottom, where the map ends, are kept; so are tiles at the wall's ends.
        assert_eq!(dropped(&exact, &near), 14 * 6);
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
        let exact = Method::Exact { step: 0.01 };
        let keep = kept(&panorama, &slabs, 8, &eyes, &exact, 1.0, &Control::default()).unwrap();
        let row = &keep[1][4 * 32..5 * 32];
        assert!(row[16] && !row[4] && !row[30], "{row:?}");
    }
}

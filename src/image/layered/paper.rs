//! Culling as the LDI culling paper has it: front to back through the octree, with an occlusion buffer (section 3.2).
//!
//! The octree is walked once for each sheet, from the epipole on (toward it, if the new eye is behind the old one): over
//! the nodes at the front, those of the greatest disparity, and from each along a ray into the depth. A node is left out if
//! the occlusion buffer is full in the whole box of its eight warped corners; else its samples are warped, splatted, and
//! added to the buffer.
//!
//! Where we depart from the paper, because as printed it fails:
//! * weights in the buffer add up to at most 1: more would not be 1, and nothing behind would ever be left out;
//! * the buffer has the size of the new image, not of the layered one;
//! * a node with a corner behind the new eye is taken as visible;
//! * what lies behind a node is looked at even if that node is hidden or empty (table 3 goes on to the next node without
//!   marking it, and never ends), and once for each sheet, not only from leaves.
//!
//! What remains is the paper's own: the order of the octree is not that of the samples where nodes differ in size, where they
//! lie across the lines between sheets, and among the samples of a node. So something hidden is drawn first here and there,
//! and what it covers left out (section 5 calls that negligible). A splat that reaches out of its node's box is lost with it. [`warp`](super::warp) has no such faults.

use super::Layered;
use super::octree::{NONE, Octree};
use super::place::rgb;
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use crate::image::warp::mapping::Mapping;
use crate::image::warp::picture::{Background, NO_SOURCE, Picture};

/// What became of a sample: the node it is in was never reached, lies outside the image, was hidden, was drawn.
pub const UNREACHED: u8 = 0;
pub const OUTSIDE: u8 = 1;
pub const HIDDEN: u8 = 2;
pub const DRAWN: u8 = 3;

/// How large splats are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Splat {
    /// So many pixels on every side of the one that a centre falls on.
    Fixed(usize),
    /// As the ratio of the new disparity to the old one (section 3.3).
    Disparity,
}

/// Splats reach so far at most.
const WIDEST: usize = 15;

/// What a splat covers at its centre's neighbours on a line, at most: the centre alone is opaque.
const EDGE: f32 = 0.75;

/// A buffer that is this full is full: weights are rounded.
const FULL: f32 = 1.0 - 1e-4;

/// Part of the image that is walked in one direction.
#[derive(Debug, Clone, Copy)]
struct Sheet {
    low: [f32; 2],
    high: [f32; 2],
    /// Along each axis from high to low.
    reversed: [bool; 2],
}

/// The leaf at the front that the epipole is in, clamped to the image, and the leaves at the front that the lines
/// through it, which part the sheets, cross (section 3.2.1).
pub fn epipolar_nodes(tree: &Octree, mapping: &Mapping) -> (u32, Vec<u32>) {
    let root = tree.nodes[0];
    let e = mapping.epipole;
    let place = [0, 1].map(|axis| {
        // At infinity, along an axis or not at all.
        let at = e[axis] / e.z.abs() * if e.z < 0.0 { -1.0 } else { 1.0 };
        let last = f64::from(root.high[axis]);
        if at.is_nan() { 0.5 * last } else { at.clamp(0.0, last.next_down()) }
    });
    let crosses = |axis: usize| e.z != 0.0 && (0.0..f64::from(root.high[axis])).contains(&(e[axis] / e.z));
    let [x, y] = place.map(|p| p as f32);
    let front = tree.find([x, y, root.high[2]], u32::MAX);
    let isometric = (0..tree.nodes.len() as u32).filter(|&index| {
        let node = &tree.nodes[index as usize];
        let within = |axis: usize, at: f32| crosses(axis) && node.low[axis] <= at && at < node.high[axis];
        node.is_leaf() && node.high[2] == root.high[2] && (within(0, x) || within(1, y))
    });
    (front, isometric.collect())
}

/// Warps a layered image to a picture of the `target` camera, leaving out nodes as the paper does; gives what became of
/// each sample.
///
/// # Errors
/// [`Error::Invalid`] for cameras that can't be warped or a picture of another size; [`Error::Interrupted`].
pub fn warp(
    layered: &Layered,
    tree: &Octree,
    target: &Camera,
    splat: Splat,
    background: Background<'_>,
    picture: &mut Picture<'_>,
    control: &Control,
) -> Result<Vec<u8>, Error> {
    let mapping = Mapping::new(layered.camera(), target)?;
    let pixels = target.width * target.height;
    picture.check(pixels)?;
    if let Background::Picture(behind) = background
        && behind.len() != pixels
    {
        return Err(Error::Invalid(format!("background has {} pixels, the camera {pixels}", behind.len())));
    }
    let mut walk = Walk {
        layered,
        tree,
        mapping: &mapping,
        splat,
        size: [target.width, target.height],
        marked: vec![false; tree.nodes.len()],
        fates: vec![UNREACHED; layered.len()],
        occlusion: vec![0.0; pixels],
        color: vec![[0.0; 3]; pixels],
        depth: vec![f32::INFINITY; pixels],
        exact: vec![false; pixels],
        step: (tree.nodes[0].high[2] - tree.nodes[0].low[2]) / (2_u32 << tree.levels) as f32,
    };
    for sheet in walk.sheets() {
        walk.across(0, &sheet, control)?;
    }
    walk.write(background, picture);
    Ok(walk.fates)
}

struct Walk<'a> {
    layered: &'a Layered,
    tree: &'a Octree,
    mapping: &'a Mapping,
    splat: Splat,
    size: [usize; 2],
    /// Leaves that were warped or left out.
    marked: Vec<bool>,
    fates: Vec<u8>,
    /// How much of a pixel is covered; 1 is all of it.
    occlusion: Vec<f32>,
    color: Vec<[f32; 3]>,
    depth: Vec<f32>,
    exact: Vec<bool>,
    /// Half the depth of the smallest node, in disparity.
    step: f32,
}

impl Walk<'_> {
    /// The parts of the image that the lines through the epipole make, front to back.
    fn sheets(&self) -> Vec<Sheet> {
        let high = self.tree.nodes[0].high;
        let e = self.mapping.epipole;
        let halves = [0, 1].map(|axis| {
            let line = if e.z == 0.0 { f64::NAN } else { e[axis] / e.z };
            // Back to front a pixel is drawn forward where `e - e_z p` is positive; here it is the other way round.
            let reversed = |p: f64| e[axis] - e.z * p > 0.0;
            let last = f64::from(high[axis]);
            if line > 0.0 && line < last {
                vec![(0.0, line as f32, reversed(0.0)), (line as f32, high[axis], reversed(last))]
            } else {
                vec![(0.0, high[axis], reversed(0.5 * last))]
            }
        });
        let mut sheets = Vec::new();
        for &(top, bottom, upward) in &halves[1] {
            for &(left, right, leftward) in &halves[0] {
                let (low, high) = ([left, top], [right, bottom]);
                sheets.push(Sheet { low, high, reversed: [leftward, upward] });
            }
        }
        sheets
    }

    /// The quarters of a node in the order of a sheet: 0 to 3, as its nearer children are.
    fn quarters(sheet: &Sheet) -> [u32; 4] {
        let first = u32::from(sheet.reversed[0]) + 2 * u32::from(sheet.reversed[1]);
        [first, first ^ 1, first ^ 2, first ^ 3]
    }

    /// Walks over the nodes at the front (table 3): a node's nearer quarters, then what is behind it.
    fn across(&mut self, index: u32, sheet: &Sheet, control: &Control) -> Result<(), Error> {
        let node = self.tree.nodes[index as usize];
        let outside = (0..2).any(|a| node.high[a] <= sheet.low[a] || node.low[a] >= sheet.high[a]);
        if outside {
            return Ok(());
        }
        if node.is_leaf() {
            self.settle(index);
        } else if let Some(fate) = self.left_out(index) {
            self.mark(index, fate);
        } else {
            for quarter in Self::quarters(sheet) {
                self.across(node.children + quarter, sheet, control)?;
            }
        }
        self.behind(index, sheet);
        control.step(1)
    }

    /// Follows the ray from a node's corner into the depth.
    fn behind(&mut self, index: u32, sheet: &Sheet) {
        let node = self.tree.nodes[index as usize];
        let end = self.tree.nodes[0].low[2];
        let corner = [0, 1].map(|a| {
            let inner = |at: f32| at.max(sheet.low[a].max(node.low[a])).min(node.high[a].next_down());
            if sheet.reversed[a] {
                inner(node.high[a].min(sheet.high[a]).next_down())
            } else {
                inner(node.low[a])
            }
        });
        let (mut z, mut last) = (node.low[2], NONE);
        if self.step <= 0.0 {
            return;
        }
        while z > end {
            z -= self.step;
            let reached = self.tree.find([corner[0], corner[1], z.max(end)], node.level);
            if reached == last {
                continue;
            }
            last = reached;
            if self.tree.nodes[reached as usize].level < node.level {
                // A larger one is only asked about: what is before the rest of it may not be drawn yet.
                if !self.marked[reached as usize]
                    && let Some(fate) = self.left_out(reached)
                {
                    self.mark(reached, fate);
                }
            } else {
                self.through(reached, sheet);
            }
        }
    }

    /// Warps a node that was reached along a ray: its parts in depth, then beside each other.
    fn through(&mut self, index: u32, sheet: &Sheet) {
        let node = self.tree.nodes[index as usize];
        if node.is_leaf() {
            self.settle(index);
        } else if let Some(fate) = self.left_out(index) {
            self.mark(index, fate);
        } else {
            for quarter in Self::quarters(sheet) {
                self.through(node.children + quarter, sheet);
                self.through(node.children + quarter + 4, sheet);
            }
        }
    }

    /// Warps a leaf or leaves it out, once.
    fn settle(&mut self, index: u32) {
        if self.marked[index as usize] {
            return;
        }
        if let Some(fate) = self.left_out(index) {
            return self.mark(index, fate);
        }
        self.marked[index as usize] = true;
        let node = self.tree.nodes[index as usize];
        for at in node.start..node.end {
            let sample = self.tree.samples[at as usize];
            self.fates[sample as usize] = DRAWN;
            self.draw(sample as usize);
        }
    }

    /// Leaves out all that is in a node and not settled yet.
    fn mark(&mut self, index: u32, fate: u8) {
        let node = self.tree.nodes[index as usize];
        if node.is_leaf() {
            if !self.marked[index as usize] {
                for &sample in &self.tree.samples[node.start as usize..node.end as usize] {
                    self.fates[sample as usize] = fate;
                }
            }
            self.marked[index as usize] = true;
        } else {
            for child in node.children..node.children + 8 {
                self.mark(child, fate);
            }
        }
    }

    /// Why nothing of a node is to be seen, if so: its box on the image is full, or outside.
    fn left_out(&self, index: u32) -> Option<u8> {
        let node = &self.tree.nodes[index as usize];
        if node.is_empty() {
            return Some(OUTSIDE);
        }
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut growth = 0.0_f64;
        for corner in 0..8 {
            let at = |axis: usize| {
                f64::from(if corner >> axis & 1 == 1 { node.high[axis] } else { node.low[axis] })
            };
            let d = at(2);
            let [u, v, new] = self.mapping.point(at(0), at(1), d)?;
            growth = growth.max(if d > 0.0 { new / d } else { 1.0 });
            low = [low[0].min(u), low[1].min(v)];
            high = [high[0].max(u), high[1].max(v)];
        }
        let reach = self.reach(growth) as f64;
        let size = self.size.map(|s| s as f64);
        // Splats reach into the image from beside it. Samples on the upper bounds are the neighbours'.
        if (0..2).any(|a| high[a] + reach < 0.0 || low[a] - reach >= size[a]) {
            return Some(OUTSIDE);
        }
        let first = [0, 1].map(|a| low[a].floor().max(0.0));
        let last = [0, 1].map(|a| (high[a].ceil() - 1.0).min(size[a] - 1.0));
        if first[0] > last[0] || first[1] > last[1] {
            return None;
        }
        let full = (first[1] as usize..=last[1] as usize).all(|y| {
            let row = &self.occlusion[y * self.size[0]..][first[0] as usize..=last[0] as usize];
            row.iter().all(|&covered| covered >= FULL)
        });
        full.then_some(HIDDEN)
    }

    /// Pixels that a splat covers on each side of its centre's.
    fn reach(&self, growth: f64) -> usize {
        match self.splat {
            Splat::Fixed(radius) => radius,
            Splat::Disparity => {
                let side = growth * self.mapping.magnification[0].max(self.mapping.magnification[1]);
                ((0.5 * side).ceil() as usize).clamp(1, WIDEST)
            }
        }
    }

    fn draw(&mut self, sample: usize) {
        let d = f64::from(self.layered.disparities()[sample]);
        let [x, y] = self.tree.places[sample].map(f64::from);
        let Some([u, v, nearness]) = self.mapping.point(x, y, d) else { return };
        let reach = self.reach(if d > 0.0 { nearness / d } else { 1.0 }) as i64;
        let (width, height) = (self.size[0] as i64, self.size[1] as i64);
        let far = (u + 1.0).abs().max((v + 1.0).abs()) > 1e6;
        if far {
            return;
        }
        let (u, v) = (u.floor() as i64, v.floor() as i64);
        let depth = (1.0 / nearness) as f32;
        let color = rgb(self.layered.colors()[sample]).map(f32::from);
        for row in (v - reach).max(0)..=(v + reach).min(height - 1) {
            for column in (u - reach).max(0)..=(u + reach).min(width - 1) {
                let centre = row == v && column == u;
                let fade = |away: i64| 1.0 - away.abs() as f32 / (reach + 1) as f32;
                let weight = if centre { 1.0 } else { EDGE * fade(row - v) * fade(column - u) };
                let pixel = (row * width + column) as usize;
                let free = 1.0 - self.occlusion[pixel];
                if free <= 0.0 {
                    continue;
                }
                let share = weight.min(free);
                if self.occlusion[pixel] == 0.0 || centre {
                    self.depth[pixel] = depth;
                    self.exact[pixel] = centre;
                }
                self.occlusion[pixel] += share;
                for (sum, channel) in self.color[pixel].iter_mut().zip(color) {
                    *sum += share * channel;
                }
            }
        }
    }

    fn write(&self, background: Background<'_>, picture: &mut Picture<'_>) {
        for pixel in 0..self.depth.len() {
            let covered = self.occlusion[pixel];
            let hole = covered == 0.0;
            picture.depth[pixel] = self.depth[pixel];
            picture.hole[pixel] = hole;
            picture.exact[pixel] = self.exact[pixel];
            picture.source[pixel] = if hole { NO_SOURCE } else { 0 };
            picture.color[pixel] = match (hole, background) {
                (false, _) => self.color[pixel].map(|c| (c / covered).round().clamp(0.0, 255.0) as u8),
                (true, Background::Black) => [0; 3],
                (true, Background::Kept) => picture.color[pixel],
                (true, Background::Picture(behind)) => behind[pixel],
            };
        }
    }
}

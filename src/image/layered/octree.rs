//! The octree over depth pixels (LDI culling paper, section 3.1).
//!
//! Its space is the layered image: column, row and disparity. The root encloses all samples; a node is divided into eight
//! until it has few samples or covers few pixels. The front is the greatest disparity.

use super::Layered;
use super::place::{STEPS, steps};

/// No node.
pub const NONE: u32 = u32::MAX;

/// When a node is not divided (table 2's thresholds).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Thresholds {
    /// It has fewer samples.
    pub count: usize,
    /// Its longer side covers less, in pixels.
    pub size: usize,
}

/// A box of the layered image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// Column, row, disparity; samples on an upper bound belong to the neighbour, except at the root's.
    pub low: [f32; 3],
    pub high: [f32; 3],
    /// The first of eight children, which are consecutive: the first four are the nearer half. Of each half the second and
    /// fourth are the right ones, the third and fourth the lower ones; the one behind child `i` is `i + 4`.
    pub children: u32,
    pub level: u32,
    /// Its samples are [`Octree::samples`]`[start..end]`.
    pub start: u32,
    pub end: u32,
}

impl Node {
    pub fn is_leaf(&self) -> bool {
        self.children == NONE
    }

    pub fn is_empty(&self) -> bool {
        self.start == self.end
    }
}

/// The nodes, the root first.
#[derive(Debug)]
pub struct Octree {
    pub nodes: Vec<Node>,
    /// Samples node by node.
    pub samples: Vec<u32>,
    /// Column and row of each sample of the layered image, in pixels.
    pub places: Vec<[f32; 2]>,
    /// The level of the smallest node.
    pub levels: u32,
}

/// Nodes are divided so often at most: more and float32 can't tell their bounds apart.
const MOST_LEVELS: u32 = 16;

impl Octree {
    /// Divides the space of a layered image. O(N) for each level.
    pub fn new(layered: &Layered, thresholds: Thresholds) -> Self {
        let width = layered.camera().width;
        let mut places = Vec::with_capacity(layered.len());
        for pixel in 0..width * layered.camera().height {
            for sample in layered.samples(pixel) {
                let [right, down] = steps(layered.colors()[sample]).map(|s| s as f32 / STEPS as f32);
                places.push([(pixel % width) as f32 + 0.5 + right, (pixel / width) as f32 + 0.5 + down]);
            }
        }
        let disparities = layered.disparities();
        let least = disparities.iter().copied().fold(f32::INFINITY, f32::min);
        let most = disparities.iter().copied().fold(0.0, f32::max);
        let root = Node {
            low: [0.0, 0.0, if least.is_finite() { least } else { 0.0 }],
            high: [width as f32, layered.camera().height as f32, most],
            children: NONE,
            level: 0,
            start: 0,
            end: layered.len() as u32,
        };
        let mut tree =
            Self { nodes: vec![root], samples: (0..layered.len() as u32).collect(), places, levels: 0 };
        let mut next = 0;
        while next < tree.nodes.len() {
            tree.divide(next, disparities, thresholds);
            next += 1;
        }
        tree
    }

    fn divide(&mut self, index: usize, disparities: &[f32], thresholds: Thresholds) {
        let node = self.nodes[index];
        self.levels = self.levels.max(node.level);
        let size = (node.high[0] - node.low[0]).max(node.high[1] - node.low[1]);
        let count = (node.end - node.start) as usize;
        if count < thresholds.count || size < thresholds.size as f32 || node.level == MOST_LEVELS {
            return;
        }
        let middle = [0, 1, 2].map(|axis| 0.5 * (node.low[axis] + node.high[axis]));
        let child_of = |sample: u32| {
            let [x, y] = self.places[sample as usize];
            let behind = disparities[sample as usize] < middle[2];
            usize::from(x >= middle[0]) + 2 * usize::from(y >= middle[1]) + 4 * usize::from(behind)
        };
        let mut parts: [Vec<u32>; 8] = Default::default();
        for &sample in &self.samples[node.start as usize..node.end as usize] {
            parts[child_of(sample)].push(sample);
        }
        self.nodes[index].children = self.nodes.len() as u32;
        let mut start = node.start;
        for (child, part) in parts.iter().enumerate() {
            let end = start + part.len() as u32;
            self.samples[start as usize..end as usize].copy_from_slice(part);
            let upper = [child & 1 != 0, child & 2 != 0, child & 4 == 0];
            let bound = |axis: usize, high: bool| match (high, upper[axis]) {
                (false, false) => node.low[axis],
                (true, true) => node.high[axis],
                _ => middle[axis],
            };
            self.nodes.push(Node {
                low: [0, 1, 2].map(|axis| bound(axis, false)),
                high: [0, 1, 2].map(|axis| bound(axis, true)),
                children: NONE,
                level: node.level + 1,
                start,
                end,
            });
            start = end;
        }
    }

    /// The leaf, or the node of a level before it, that a point of the root's box is in.
    pub fn find(&self, point: [f32; 3], level: u32) -> u32 {
        let mut index = 0;
        loop {
            let node = &self.nodes[index as usize];
            if node.is_leaf() || node.level == level {
                return index;
            }
            let middle = [0, 1, 2].map(|axis| 0.5 * (node.low[axis] + node.high[axis]));
            let behind = point[2] < middle[2];
            index = node.children
                + u32::from(point[0] >= middle[0])
                + 2 * u32::from(point[1] >= middle[1])
                + 4 * u32::from(behind);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Projection};
    use glam::{DMat3, DVec3, dvec3};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_sample_is_in_one_leaf_and_in_its_box(
            counts in prop::collection::vec(0_u32..4, 20 * 12), disparity in prop::collection::vec(0.01_f32..1.0, 720),
            count in 1_usize..40, size in 1_usize..16,
        ) {
            let camera = Camera {
                k: DMat3::from_cols(DVec3::X * 20.0, DVec3::Y * 20.0, dvec3(10.0, 6.0, 1.0)),
                rotation: DMat3::IDENTITY,
                translation: DVec3::ZERO,
                width: 20,
                height: 12,
                near: 0.0,
                projection: Projection::Perspective,
            };
            let (mut offsets, mut disparities) = (vec![0], Vec::new());
            for (pixel, count) in counts.iter().enumerate() {
                let mut own = disparity[3 * pixel..][..*count as usize].to_vec();
                own.sort_by(|a, b| b.total_cmp(a));
                disparities.extend(own);
                offsets.push(disparities.len() as u32);
            }
            let n = disparities.len();
            let layered = Layered::new(camera, offsets, vec![0; n], disparities).unwrap();
            let thresholds = Thresholds { count, size };
            let tree = Octree::new(&layered, thresholds);
            let mut seen = vec![0; n];
            for (index, node) in tree.nodes.iter().enumerate() {
                let side = (node.high[0] - node.low[0]).max(node.high[1] - node.low[1]);
                let small = ((node.end - node.start) as usize) < count || side < size as f32;
                prop_assert!(node.is_leaf() == small || node.level == MOST_LEVELS);
                if !node.is_leaf() {
                    let children = &tree.nodes[node.children as usize..][..8];
                    prop_assert!(children[..4].iter().zip(&children[4..]).all(|(f, b)| f.low[2] >= b.high[2]));
                    continue;
                }
                for &sample in &tree.samples[node.start as usize..node.end as usize] {
                    seen[sample as usize] += 1;
                    let [x, y] = tree.places[sample as usize];
                    let p = [x, y, layered.disparities()[sample as usize]];
                    prop_assert!((0..3).all(|a| node.low[a] <= p[a] && p[a] <= node.high[a]));
                    prop_assert_eq!(tree.find(p, u32::MAX) as usize, index);
                }
            }
            prop_assert!(seen.iter().all(|&s| s == 1));
        }
    }
}

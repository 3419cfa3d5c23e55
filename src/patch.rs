//! Cutting a mesh into compact patches by fusing the smallest with a neighbour.
//!
//! The tiling of the 2002 paper (section 3.1): every face begins as a patch; the smallest by area is fused
//! with the neighbour "such that the increase in the extension of the patch is minimized", until the asked
//! count is left. The extension is the diagonal of the axis-aligned bounding box, and the patch whose
//! increase counts is the smallest one: `diagonal(fused) - diagonal(smallest)`. Ties, which the paper leaves open,
//! go to the lowest id, where a patch's id is its lowest face: among equally small patches, and
//! among neighbours with equal increases.

use crate::adjacency::{Csr, edge_faces};
use crate::control::Control;
use crate::error::Error;
use glam::DVec3;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// Fusions between two looks at whether the caller wants to stop.
const FUSIONS_A_STEP: usize = 256;

/// A bounding box.
#[derive(Clone, Copy)]
struct Extent {
    low: DVec3,
    high: DVec3,
}

impl Extent {
    fn with(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn diagonal(self) -> f64 {
        let side = self.high - self.low;
        (side.x * side.x + side.y * side.y + side.z * side.z).sqrt()
    }
}

/// What is fused: a set of faces.
struct Patch {
    /// Lowest face.
    id: u32,
    area: f64,
    extent: Extent,
    /// Edges among which are all those to other patches.
    edges: Vec<u32>,
}

/// A patch in the queue, stale once its area or id has changed.
#[derive(PartialEq)]
struct Entry {
    area: f64,
    id: u32,
}

impl Eq for Entry {}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.area.total_cmp(&other.area).then(self.id.cmp(&other.id))
    }
}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The fusion in progress.
struct Tiling<'a> {
    edges: &'a Csr,
    patches: Vec<Patch>,
    /// Union-find forest over faces; a root's number is its patch's place in `patches`.
    parent: Vec<u32>,
    /// The fusion at which a patch was last listed as a neighbour.
    listed: Vec<u32>,
}

impl Tiling<'_> {
    fn root(&mut self, mut face: u32) -> u32 {
        while self.parent[face as usize] != face {
            let above = self.parent[self.parent[face as usize] as usize];
            self.parent[face as usize] = above;
            face = above;
        }
        face
    }

    /// Visits each neighbour of the patch `root` once and returns the one to fuse with.
    ///
    /// Edges which show no patch that an earlier edge has not shown are dropped: fusing only ever
    /// joins the patches they show. So a list shrinks to its patch's neighbours each time it is read, and a
    /// face's edges are read again only after its patch has at least doubled its area.
    fn best_neighbor(&mut self, root: u32, stamp: u32) -> Option<u32> {
        let own = &mut self.patches[root as usize];
        let (extent, diagonal) = (own.extent, own.extent.diagonal());
        let mut kept = std::mem::take(&mut own.edges);
        let edges = self.edges;
        let mut best: Option<(f64, u32, u32)> = None;
        self.listed[root as usize] = stamp;
        kept.retain(|&edge| {
            let mut news = false;
            for &face in edges.list(edge as usize) {
                let other = self.root(face);
                if self.listed[other as usize] == stamp {
                    continue;
                }
                self.listed[other as usize] = stamp;
                news = true;
                let neighbor = &self.patches[other as usize];
                let increase = extent.with(neighbor.extent).diagonal() - diagonal;
                if best.is_none_or(|(least, id, _)| (increase, neighbor.id) < (least, id)) {
                    best = Some((increase, neighbor.id, other));
                }
            }
            news
        });
        self.patches[root as usize].edges = kept;
        best.map(|(_, _, other)| other)
    }

    /// Joins two patches; the one with more edges keeps its place. Returns that place.
    fn fuse(&mut self, a: u32, b: u32) -> u32 {
        let edges_of = |p: u32| self.patches[p as usize].edges.len();
        let (keep, give) = if edges_of(a) < edges_of(b) { (b, a) } else { (a, b) };
        let given = std::mem::take(&mut self.patches[give as usize].edges);
        let Patch { id, area, extent, .. } = self.patches[give as usize];
        let kept = &mut self.patches[keep as usize];
        kept.id = kept.id.min(id);
        kept.area += area;
        kept.extent = kept.extent.with(extent);
        kept.edges.extend(given);
        self.parent[give as usize] = keep;
        keep
    }
}

/// A patch number below the returned count for each face, and that count.
///
/// The count is `count` where the mesh has no more connected components than that and no fewer faces; else
/// each component, or each face, is a patch. Faces connect along edges, by position (see
/// [`adjacency`](crate::adjacency)). Patches are numbered by their lowest face. Two patches with a
/// common edge only ever fuse whole, so each patch is connected.
///
/// O(F log F) for faces of comparable area. A connected cluster of many faces without any area is
/// quadratic in its size: ties make one patch of it grow face by face.
///
/// # Errors
/// [`Error::Invalid`] if `count` is zero; [`Error::Interrupted`].
pub fn tile(
    positions: &[DVec3],
    faces: &[[u32; 3]],
    count: usize,
    control: &Control,
) -> Result<(Vec<u32>, usize), Error> {
    if count == 0 {
        return Err(Error::Invalid("count must be at least 1, got 0".into()));
    }
    let edges = edge_faces(positions, faces);
    let patches = single_faces(positions, faces, &edges);
    let mut queue: BinaryHeap<_> =
        patches.iter().map(|p| Reverse(Entry { area: p.area, id: p.id })).collect();
    let mut tiling = Tiling {
        edges: &edges,
        patches,
        parent: (0..faces.len() as u32).collect(),
        listed: vec![u32::MAX; faces.len()],
    };
    let mut left = faces.len();
    while left > count {
        let Some(Reverse(smallest)) = queue.pop() else { break };
        let place = tiling.root(smallest.id);
        let current = &tiling.patches[place as usize];
        if current.id != smallest.id || current.area != smallest.area {
            continue;
        }
        // A patch without neighbours is a whole component: it leaves the queue for good.
        let Some(neighbor) = tiling.best_neighbor(place, left as u32) else { continue };
        let fused = tiling.fuse(place, neighbor);
        let Patch { id, area, .. } = tiling.patches[fused as usize];
        queue.push(Reverse(Entry { area, id }));
        left -= 1;
        if left.is_multiple_of(FUSIONS_A_STEP) {
            control.step(FUSIONS_A_STEP)?;
        }
    }
    let mut number = vec![u32::MAX; faces.len()];
    let mut next = 0;
    let labels = (0..faces.len() as u32)
        .map(|face| {
            let root = tiling.root(face) as usize;
            if number[root] == u32::MAX {
                number[root] = next;
                next += 1;
            }
            number[root]
        })
        .collect();
    Ok((labels, left))
}

/// Each face as a patch.
///
/// Positions are scaled by a power of two so that the farthest coordinate is near 1: areas of tiny or huge
/// meshes then neither vanish nor overflow, and no digit changes.
fn single_faces(positions: &[DVec3], faces: &[[u32; 3]], edges: &Csr) -> Vec<Patch> {
    let farthest = positions.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
    let scale = if farthest > 0.0 { (-farthest.log2().ceil()).clamp(-1022.0, 1023.0).exp2() } else { 1.0 };
    let mut patches: Vec<Patch> = faces
        .iter()
        .zip(0..)
        .map(|(corners, id)| {
            let [a, b, c] = corners.map(|v| positions[v as usize] * scale);
            let normal = (b - a).cross(c - a);
            let area = 0.5 * (normal.x * normal.x + normal.y * normal.y + normal.z * normal.z).sqrt();
            let extent = Extent { low: a.min(b).min(c), high: a.max(b).max(c) };
            Patch { id, area, extent, edges: Vec::with_capacity(3) }
        })
        .collect();
    for edge in 0..edges.len() {
        let list = edges.list(edge);
        if list.len() > 1 {
            list.iter().for_each(|&face| patches[face as usize].edges.push(edge as u32));
        }
    }
    patches
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of `n` unit squares along x, two triangles each.
    fn strip(n: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let positions =
            (0..2 * (n + 1)).map(|k| DVec3::new(f64::from(k / 2), f64::from(k % 2), 0.0)).collect();
        let faces = (0..n).flat_map(|k| [[2 * k, 2 * k + 2, 2 * k + 1], [2 * k + 1, 2 * k + 2, 2 * k + 3]]);
        (positions, faces.collect())
    }

    #[test]
    fn halves_of_a_square_fuse_first() {
        let (positions, faces) = strip(3);
        let (labels, count) = tile(&positions, &faces, 3, &Control::default()).unwrap();
        assert_eq!((labels, count), (vec![0, 0, 1, 1, 2, 2], 3));
    }

    #[test]
    fn a_count_past_the_faces_gives_each_its_own() {
        let (positions, faces) = strip(2);
        let (labels, count) = tile(&positions, &faces, 9, &Control::default()).unwrap();
        assert_eq!((labels, count), (vec![0, 1, 2, 3], 4));
    }

    #[test]
    fn components_never_fuse() {
        let (mut positions, mut faces) = strip(2);
        positions.extend([DVec3::splat(5.0), DVec3::splat(6.0), DVec3::new(5.0, 6.0, 7.0)]);
        faces.insert(1, [6, 7, 8]);
        let (labels, count) = tile(&positions, &faces, 1, &Control::default()).unwrap();
        assert_eq!((labels, count), (vec![0, 1, 0, 0, 0], 2));
    }

    #[test]
    fn the_scale_of_the_mesh_changes_nothing() {
        let (positions, faces) = strip(40);
        let tiled = |scale: f64| {
            let scaled: Vec<_> = positions.iter().map(|&p| p * scale).collect();
            tile(&scaled, &faces, 7, &Control::default()).unwrap()
        };
        assert_eq!(tiled(2f64.powi(-300)), tiled(1.0));
        assert_eq!(tiled(2f64.powi(600)), tiled(1.0));
    }

    #[test]
    fn a_stopped_tiling_says_so() {
        let (positions, faces) = strip(1000);
        let control = Control::default();
        control.stop();
        assert_eq!(tile(&positions, &faces, 1, &control), Err(Error::Interrupted));
        let err = tile(&positions, &faces, 0, &Control::default()).unwrap_err();
        assert_eq!(err.to_string(), "count must be at least 1, got 0");
    }
}

//! From faces to cells, level by level.

use super::{Node, Octree, overlaps};
use crate::bounds::Bounds;
use crate::control::Control;
use crate::error::Error;
use crate::mesh::Mesh;
use glam::DVec3;
use rayon::prelude::*;

/// The deepest level that may be asked for: cells are then a millionth of the scene.
pub const MOST_LEVELS: u32 = 20;

/// Where dividing ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// A cell of at most so many faces is not divided.
    pub leaf_faces: usize,
    /// The root has level 0, no cell is below this.
    pub depth: u32,
    /// For how many levels a crossing face is passed down: 0 is the conventional tree.
    pub stop: u32,
}

/// A cell is not divided where its parts would have more than so many times its faces together.
///
/// Measured: cells of a surface come to 1.3 times at 50 faces and 2 at 8. Faces that all lie in one place come to 4, at every
/// level again, and dividing would never part them.
const MOST_COPIES: usize = 2;

/// Fewer faces than this are sorted by one thread.
const ALONE: usize = 4096;

/// A face on its way down: for how many levels it has been a crossing one, [`WHOLE`] if never.
type Entry = (u32, u8);

const WHOLE: u8 = u8::MAX;

/// A cell before it has a number.
struct Grown {
    bounds: Bounds,
    own: Vec<u32>,
    below: Vec<Grown>,
    /// Crossing faces in this cell's list, and faces that cross here for the first time.
    passed: usize,
    crossing: usize,
}

struct Grower<'a> {
    mesh: &'a Mesh,
    limits: Limits,
    control: &'a Control,
}

impl Octree {
    /// Divides the mesh's bounding cube; a unit of progress is a face. Empty cells are left out.
    ///
    /// # Errors
    /// [`Error::Invalid`] for limits out of range, or where references would not fit 32 bits; [`Error::Interrupted`].
    pub fn new(mesh: &Mesh, limits: Limits, control: &Control) -> Result<Self, Error> {
        if limits.leaf_faces == 0 || limits.depth > MOST_LEVELS {
            return Err(Error::Invalid(format!(
                "leaf_faces must be at least 1 and depth at most {MOST_LEVELS}, got {} and {}",
                limits.leaf_faces, limits.depth
            )));
        }
        let faces = mesh.faces().len();
        let bounds = (0..faces)
            .into_par_iter()
            .map(|f| Bounds::of(mesh.corners(f)))
            .reduce(|| Bounds::EMPTY, |a, b| a.union(b));
        let half = DVec3::splat(bounds.size().max_element() * 0.5);
        let cell = Bounds { low: bounds.center() - half, high: bounds.center() + half };
        let entries = (0..faces as u32).map(|face| (face, WHOLE)).collect();
        let root = Grower { mesh, limits, control }.grow(entries, cell.union(bounds), 0)?;
        let mut tree = Self { nodes: Vec::new(), references: Vec::new(), faces, crossing: 0, by_level: 0 };
        tree.number(root, 0)?;
        Ok(tree)
    }

    fn number(&mut self, cell: Grown, level: u32) -> Result<(), Error> {
        let index = self.nodes.len();
        let first = self.references.len() as u32;
        self.references.extend(cell.own);
        let own_end = self.references.len() as u32;
        self.nodes.push(Node { bounds: cell.bounds, first, own_end, end: own_end, next: 0, level });
        self.crossing += cell.crossing;
        self.by_level += cell.passed as u64;
        for part in cell.below {
            self.number(part, level + 1)?;
        }
        if u32::try_from(self.references.len()).is_err() {
            return Err(Error::Invalid(
                "the cells refer to 2^32 faces or more: set a lower stop or depth".into(),
            ));
        }
        self.nodes[index].end = self.references.len() as u32;
        self.nodes[index].next = self.nodes.len() as u32;
        Ok(())
    }
}

impl Grower<'_> {
    fn grow(&self, entries: Vec<Entry>, cell: Bounds, level: u32) -> Result<Grown, Error> {
        let passed = entries.iter().filter(|e| e.1 != WHOLE).count();
        let parts: [Bounds; 8] = parts(&cell);
        let divided = (entries.len() > self.limits.leaf_faces && level < self.limits.depth)
            .then(|| self.touched(&entries, &cell, &parts))
            .filter(|touched| self.pays(&entries, touched));
        let Some(touched) = divided else {
            self.control.step(entries.len() - passed)?;
            let own: Vec<_> = entries.into_iter().map(|e| e.0).collect();
            return Ok(Grown {
                bounds: self.reach(&own, &cell),
                own,
                below: Vec::new(),
                passed,
                crossing: 0,
            });
        };
        let mut own = Vec::new();
        let mut lists: [Vec<Entry>; 8] = Default::default();
        let mut crossing = 0;
        for (&(face, age), mask) in entries.iter().zip(touched) {
            crossing += usize::from(age == WHOLE && mask.count_ones() > 1);
            match self.aged(age, mask) {
                None => own.push(face),
                Some(age) => {
                    (0..8).filter(|part| mask >> part & 1 == 1).for_each(|part| lists[part].push((face, age)))
                }
            }
        }
        let whole = entries.len() - passed;
        drop(entries);
        self.control.step(crossing)?;
        debug_assert!(crossing <= whole);
        let lists: Vec<_> = lists.into_iter().zip(parts).filter(|(list, _)| !list.is_empty()).collect();
        let below = if whole + passed < ALONE {
            lists
                .into_iter()
                .map(|(list, part)| self.grow(list, part, level + 1))
                .collect::<Result<Vec<_>, _>>()
        } else {
            lists.into_par_iter().map(|(list, part)| self.grow(list, part, level + 1)).collect()
        }?;
        let bounds = below.iter().fold(self.reach(&own, &cell), |b, part| b.union(part.bounds));
        Ok(Grown { bounds, own, below, passed, crossing })
    }

    /// Of each face, which of the eight parts it touches, a bit each.
    fn touched(&self, entries: &[Entry], cell: &Bounds, parts: &[Bounds; 8]) -> Vec<u8> {
        let middle = cell.center();
        let of = |&(face, _): &Entry| {
            let corners = self.mesh.corners(face as usize);
            let own = Bounds::of(corners);
            let (low, high) = (own.low.cmple(middle).bitmask(), own.high.cmpge(middle).bitmask());
            let candidate = |part: u32| (low | part) & (high | !part) & 7 == 7;
            let mask = (0..8).filter(|&part| candidate(part)).fold(0_u8, |mask, part| mask | 1 << part);
            if mask.count_ones() == 1 {
                return mask;
            }
            let exact = (0..8)
                .filter(|&part| mask >> part & 1 == 1 && overlaps(corners, &parts[part]))
                .fold(0, |mask, part| mask | 1 << part);
            // A face that is here by rounding alone may touch none of the parts.
            if exact == 0 { mask } else { exact }
        };
        if entries.len() < ALONE {
            entries.iter().map(of).collect()
        } else {
            entries.par_iter().map(of).collect()
        }
    }

    /// Whether dividing would part the faces.
    fn pays(&self, entries: &[Entry], touched: &[u8]) -> bool {
        let (mut down, mut copies) = (0, 0);
        for (entry, mask) in entries.iter().zip(touched) {
            if self.aged(entry.1, *mask).is_some() {
                down += 1;
                copies += mask.count_ones() as usize;
            }
        }
        down > 0 && copies <= MOST_COPIES * down
    }

    /// The age below of a face that touches these parts; `None` where it stops.
    fn aged(&self, age: u8, mask: u8) -> Option<u8> {
        match age {
            WHOLE if mask.count_ones() == 1 => Some(WHOLE),
            WHOLE => (self.limits.stop > 0).then_some(1),
            _ => (u32::from(age) < self.limits.stop).then(|| age + 1),
        }
    }

    /// The part of a cell that the boxes of faces reach.
    fn reach(&self, faces: &[u32], cell: &Bounds) -> Bounds {
        let of = |&face: &u32| {
            let own = Bounds::of(self.mesh.corners(face as usize));
            Bounds { low: own.low.max(cell.low), high: own.high.min(cell.high) }
        };
        faces.iter().map(of).fold(Bounds::EMPTY, Bounds::union)
    }
}

/// The eight parts of a cell, bit 0 of the number upper in x, bit 1 in y, bit 2 in z; all meet in its middle.
fn parts(cell: &Bounds) -> [Bounds; 8] {
    let middle = cell.center();
    cell.corners().map(|corner| Bounds::of([corner, middle]))
}

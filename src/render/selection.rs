//! Some of the faces that are in clusters: which of a cluster's are to be drawn.

use super::clusters::{Cluster, FACE_PADDING, MOST_FACES};

/// A set of faces, a bit each.
#[derive(Debug, Clone)]
pub struct Selection {
    words: Vec<u64>,
}

impl Selection {
    /// Of `count` faces those that `ids` names; all must be below `count`.
    pub fn new(count: usize, ids: &[u32]) -> Self {
        let mut words = vec![0; count.div_ceil(64)];
        for &id in ids {
            words[id as usize / 64] |= 1 << (id % 64);
        }
        Self { words }
    }

    #[inline(always)]
    pub fn contains(&self, id: u32) -> bool {
        self.words[id as usize / 64] >> (id % 64) & 1 != 0
    }
}

/// Room for those faces of a cluster that are selected.
pub struct Selected {
    corners: [u32; MOST_FACES],
    ids: [u32; MOST_FACES],
}

impl Default for Selected {
    fn default() -> Self {
        Self { corners: [0; MOST_FACES], ids: [0; MOST_FACES] }
    }
}

impl Selected {
    /// The cluster with its selected faces alone, padded as it was; `None` if there are none.
    #[inline(always)]
    pub fn of<'a>(&'a mut self, cluster: &Cluster<'a>, selection: &Selection) -> Option<Cluster<'a>> {
        let mut count = 0;
        for (&corners, &id) in cluster.corners.iter().zip(cluster.ids).take(cluster.count) {
            self.corners[count] = corners;
            self.ids[count] = id;
            count += usize::from(selection.contains(id));
        }
        if count == 0 {
            return None;
        }
        if count == cluster.count {
            return Some(*cluster);
        }
        let padded = count.next_multiple_of(FACE_PADDING);
        for place in count..padded {
            self.corners[place] = self.corners[count - 1];
            self.ids[place] = self.ids[count - 1];
        }
        Some(Cluster { count, corners: &self.corners[..padded], ids: &self.ids[..padded], ..*cluster })
    }
}

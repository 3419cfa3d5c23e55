//! Visible faces that own no pixel, guessed from those beside them (2001 paper, section 3.1.1).
//!
//! A face that shares an edge with a visible one and turns the same side to the eye is taken to be visible too.
//! That is a guess: it adds hidden faces along every silhouette, and repeated until nothing changes it floods all
//! that faces the eye. [`confirm`](super::confirm) proves what this assumes.

use super::raster::pixel_box;
use super::triangle::facing;
use super::view::{Vertex, View};
use crate::adjacency::Csr;
use crate::mesh::Mesh;

/// The faces to add to `seen`, those of an id-buffer: up to `rings` rings of neighbours not `known` yet.
///
/// Stops early where a ring adds nothing. O(F) for each ring that adds something.
pub fn beside(
    view: &View,
    mesh: &Mesh,
    adjacency: &Csr,
    seen: Vec<u32>,
    rings: usize,
    known: impl Fn(u32) -> bool,
) -> Vec<u32> {
    let in_image = |corners: &[Vertex; 3]| pixel_box(view, corners, &(0..view.height), 0.5).is_some();
    let mut taken = vec![false; mesh.faces().len()];
    let mut added = Vec::new();
    let mut ring = seen;
    for _ in 0..rings {
        let mut next = Vec::new();
        for &face in &ring {
            let side = facing(&view.project_face(mesh, face));
            for &neighbour in adjacency.list(face as usize) {
                if !taken[neighbour as usize] && !known(neighbour) {
                    let corners = view.project_face(mesh, neighbour);
                    if facing(&corners) != side || !in_image(&corners) {
                        continue;
                    }
                    taken[neighbour as usize] = true;
                    next.push(neighbour);
                }
            }
        }
        if next.is_empty() {
            break;
        }
        added.extend_from_slice(&next);
        ring = next;
    }
    added
}

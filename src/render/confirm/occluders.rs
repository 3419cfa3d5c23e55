//! Faces that hide points of others, set up for one view: what hides one face often hides those beside it.

use crate::mesh::Mesh;
use crate::render::BACKGROUND;
use crate::render::triangle::{Nearness, Triangle};
use crate::render::view::{Vertex, View};

/// How many are kept, each in the place that its number gives it.
const PLACES: usize = 1024;

/// Faces as a view sees them, set up when they are first asked for.
pub struct Occluders {
    faces: [u32; PLACES],
    triangles: Vec<Option<Triangle>>,
}

impl Default for Occluders {
    fn default() -> Self {
        Self { faces: [BACKGROUND; PLACES], triangles: vec![None; PLACES] }
    }
}

impl Occluders {
    /// Keeps none: the view is another.
    pub fn clear(&mut self) {
        self.faces.fill(BACKGROUND);
    }

    /// A face, unless it covers nothing.
    #[inline(always)]
    pub fn get(&mut self, view: &View, mesh: &Mesh, face: u32) -> Option<&Triangle> {
        let place = face as usize % PLACES;
        if self.faces[place] != face {
            self.faces[place] = face;
            self.triangles[place] = Triangle::new(view, &view.project_face(mesh, face));
        }
        self.triangles[place].as_ref()
    }
}

/// Whether one face is nearer than all of another: than each of its corners, and so, both being flat, than all
/// between them.
#[inline(always)]
pub fn hides_all(view: &View, occluder: &Triangle, corners: &[Vertex; 3]) -> bool {
    corners.iter().all(|corner| {
        corner.w > 0.0
            && occluder
                .hit(corner.x / corner.w, corner.y / corner.w)
                .is_some_and(|n| n.is_before(Nearness(corner.value), view.projection))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::fixtures::{balls, cameras};
    use proptest::prelude::*;

    proptest! {
        /// Also of faces that share a place, and of one view after another.
        #[test]
        fn faces_are_as_if_set_up_anew(
            mesh in balls(),
            cameras in prop::array::uniform2(cameras()),
            asked in prop::collection::vec((any::<u32>(), 0_u32..3), 1..60),
        ) {
            let count = mesh.faces().len() as u32;
            let mut occluders = Occluders::default();
            for camera in cameras {
                let view = View::new(&mesh, &camera);
                occluders.clear();
                for &(face, step) in &asked {
                    let face = (face % count + step * PLACES as u32) % count;
                    let anew = Triangle::new(&view, &view.project_face(&mesh, face));
                    prop_assert_eq!(format!("{:?}", occluders.get(&view, &mesh, face)), format!("{:?}", anew.as_ref()));
                }
            }
        }
    }
}

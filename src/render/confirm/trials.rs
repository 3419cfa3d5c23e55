//! Points of faces that are yet to be tested, and the faces known to hide some: what hides one point of a face often
//! hides most of it, so that a few points decide about many.

use super::occluders::Occluders;
use super::place::{Test, plane_at};
use super::points::{OPEN, Point};
use crate::camera::Projection;
use crate::mesh::Mesh;
use crate::render::lanes::{Kernel, Lanes, MOST_LANES};
use crate::render::triangle::Nearness;
use crate::render::view::View;

/// Different faces that are remembered to hide points of one face.
pub const HIDERS: usize = 8;

/// Faces that hide points of a face, each once, then [`OPEN`]s.
#[derive(Debug, Clone, Copy)]
pub struct Hiders([u32; HIDERS]);

impl Hiders {
    pub const NONE: Self = Self([OPEN; HIDERS]);

    /// Those that there are.
    pub fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        self.0.iter().copied().take_while(|&face| face != OPEN)
    }

    /// Remembers one more, if there is room.
    pub fn add(&mut self, hider: u32) {
        if let Some(place) = self.0.iter_mut().find(|face| **face == OPEN || **face == hider) {
            *place = hider;
        }
    }
}

/// Points of some faces, face by face.
#[derive(Debug, Default)]
pub struct Trials {
    /// Where the points of each face begin and end.
    spans: Vec<[u32; 2]>,
    /// Padded by a register.
    x: Vec<f64>,
    y: Vec<f64>,
    values: Vec<f64>,
    /// What is known to hide points of each, and was not yet used to drop others.
    hiders: Vec<Hiders>,
    open: Vec<bool>,
}

impl Trials {
    pub fn clear(&mut self) {
        self.spans.clear();
        self.x.clear();
        self.y.clear();
        self.values.clear();
        self.hiders.clear();
        self.open.clear();
    }

    /// Begins with the next face.
    pub fn begin(&mut self) {
        self.spans.push([self.x.len() as u32; 2]);
        self.hiders.push(Hiders::NONE);
        self.open.push(false);
    }

    /// Adds a point of the last face.
    #[inline(always)]
    pub fn push(&mut self, x: f64, y: f64, value: f64) {
        self.x.push(x);
        self.y.push(y);
        self.values.push(value);
        if let Some([_, end]) = self.spans.last_mut() {
            *end += 1;
        }
    }

    /// Lists at most so many points of each face.
    pub fn pick(&self, most: usize, list: &mut Vec<Point>) {
        for (owner, &[start, end]) in self.spans.iter().enumerate() {
            let count = (end - start) as usize;
            let picked = count.min(most);
            for pick in 0..picked {
                let at = start as usize + (2 * pick + 1) * count / (2 * picked);
                list.push(Point {
                    x: self.x[at],
                    y: self.y[at],
                    value: self.values[at],
                    owner: owner as u32,
                });
            }
        }
    }

    /// Takes in which face hides the point of an owner, or [`OPEN`].
    pub fn learn(&mut self, answers: impl Iterator<Item = (u32, u32)>) {
        for (owner, hider) in answers {
            if hider == OPEN {
                self.open[owner as usize] = true;
            } else {
                self.hiders[owner as usize].add(hider);
            }
        }
    }

    /// The faces with an open point.
    pub fn found(&self) -> impl Iterator<Item = usize> + '_ {
        self.open.iter().enumerate().filter_map(|(owner, &open)| open.then_some(owner))
    }
}

/// Drops all points of faces that have an open one, and those that a known face hides, as a kernel.
pub struct Thin<'a> {
    pub trials: &'a mut Trials,
    pub occluders: &'a mut Occluders,
    pub view: &'a View,
    pub mesh: &'a Mesh,
}

impl Kernel for Thin<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { trials, occluders, view, mesh } = self;
        let Trials { spans, x, y, values, hiders, open } = trials;
        let room = x.len().max(spans.last().map_or(0, |span| span[1] as usize + MOST_LANES));
        for array in [&mut *x, &mut *y, &mut *values] {
            array.resize(room, 0.0);
        }
        for ((span, hiders), &open) in spans.iter_mut().zip(hiders).zip(&*open) {
            if open {
                span[1] = span[0];
            }
            for hider in std::mem::replace(hiders, Hiders::NONE).iter() {
                if span[0] == span[1] {
                    break;
                }
                let Some(triangle) = occluders.get(view, mesh, hider) else { continue };
                let test = Test::<L>::new(triangle);
                let mut kept = span[0] as usize;
                for first in (span[0] as usize..span[1] as usize).step_by(L::COUNT) {
                    let real = (1_u32 << (span[1] as usize - first).min(L::COUNT)) - 1;
                    // SAFETY: the arrays have a register of entries past the last point.
                    let (px, py, value) = unsafe {
                        let arrays = [&x[first..], &y[first..], &values[first..]];
                        (
                            L::load(arrays[0].as_ptr()),
                            L::load(arrays[1].as_ptr()),
                            L::load(arrays[2].as_ptr()),
                        )
                    };
                    let hidden = test.hides(view, px, py, value);
                    let mut left = real & !L::bits(hidden);
                    while left != 0 {
                        let at = first + left.trailing_zeros() as usize;
                        left &= left - 1;
                        (x[kept], y[kept], values[kept]) = (x[at], y[at], values[at]);
                        kept += 1;
                    }
                }
                span[1] = kept as u32;
            }
        }
    }
}

impl<L: Lanes> Test<L> {
    /// Which of some points the face is before, as [`Nearness::is_before`] has it.
    #[inline(always)]
    pub fn hides(&self, view: &View, x: L, y: L, value: L) -> L::Mask {
        let (covers, here) = self.at(view, x, y);
        let limit = value.mul(L::splat(Nearness(1.0).limit(view.projection)));
        L::and(
            covers,
            if view.projection == Projection::Perspective { here.gt(limit) } else { limit.gt(here) },
        )
    }

    /// Where the face covers some positions, and its value there.
    #[inline(always)]
    pub fn at(&self, view: &View, x: L, y: L) -> (L::Mask, L) {
        let mut mask = plane_at(self.edges[0], x, y).ge(self.least[0]);
        mask = L::and(mask, plane_at(self.edges[1], x, y).ge(self.least[1]));
        mask = L::and(mask, plane_at(self.edges[2], x, y).ge(self.least[2]));
        let value = plane_at(self.plane, x, y).max(self.range[0]).min(self.range[1]);
        let seen = view.seen();
        (L::and(mask, L::and(value.ge(L::splat(seen[0])), L::splat(seen[1]).ge(value))), value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::fixtures::{cameras, meshes};
    use crate::render::lanes::InstructionSet;
    use crate::render::triangle::Triangle;
    use proptest::prelude::*;

    #[test]
    fn hiders_are_remembered_once_and_as_many_as_there_is_room_for() {
        let mut hiders = Hiders::NONE;
        assert_eq!(hiders.iter().count(), 0);
        for face in [7, 3, 7, 3, 9] {
            hiders.add(face);
        }
        assert_eq!(hiders.iter().collect::<Vec<_>>(), [7, 3, 9]);
        (10..40).for_each(|face| hiders.add(face));
        assert_eq!(hiders.iter().count(), HIDERS);
    }

    proptest! {
        /// Points on faces, some of which have an open one; hiders are any faces.
        #[test]
        fn what_is_left_is_what_no_known_face_hides(
            mesh in meshes(),
            camera in cameras(),
            wanted in prop::collection::vec((0.0_f64..=1.0, 0.0_f64..=1.0, any::<u32>()), 1..120),
            owners in prop::collection::vec((prop::collection::vec(any::<u32>(), 0..5), any::<bool>()), 1..7),
            most in 1_usize..9,
        ) {
            let view = View::new(&mesh, &camera);
            let count = mesh.faces().len() as u32;
            let triangle = |face: u32| Triangle::new(&view, &view.project_face(&mesh, face % count));
            let points: Vec<Point> = wanted
                .iter()
                .filter_map(|&(x, y, face)| {
                    let [x, y] = [(x - 0.5) * view.width as f64, (y - 0.5) * view.height as f64];
                    // The same point on some of the faces there.
                    let hits = (0..count).filter_map(|face| triangle(face)?.hit(x, y)).map(|n| n.0);
                    let hits: Vec<f64> = hits.collect();
                    let value = *hits.get(face as usize % hits.len().max(1))?;
                    Some(Point { x, y, value, owner: face % owners.len() as u32 })
                })
                .collect();
            for set in InstructionSet::available() {
                let mut trials = Trials::default();
                trials.begin();
                trials.push(0.0, 0.0, 1.0);
                trials.clear();
                for owner in 0..owners.len() {
                    trials.begin();
                    for point in points.iter().filter(|point| point.owner == owner as u32) {
                        trials.push(point.x, point.y, point.value);
                    }
                }
                let answers = owners.iter().enumerate().flat_map(|(owner, (hiders, open))| {
                    let hidden = hiders.iter().map(|face| face % count);
                    hidden.chain(open.then_some(OPEN)).map(move |answer| (owner as u32, answer))
                });
                trials.learn(answers);
                let occluders = &mut Occluders::default();
                set.run(Thin { trials: &mut trials, occluders, view: &view, mesh: &mesh });
                let left = |owner: u32| {
                    let (hiders, open) = &owners[owner as usize];
                    let of_owner = points.iter().filter(move |point| point.owner == owner && !open);
                    let hidden = move |point: &Point| {
                        hiders.iter().any(|&face| {
                            let hit = triangle(face).and_then(|triangle| triangle.hit(point.x, point.y));
                            hit.is_some_and(|n| n.is_before(Nearness(point.value), view.projection))
                        })
                    };
                    of_owner.filter(move |point| !hidden(point)).map(|point| (point.x, point.y, point.value))
                };
                let mut picked = Vec::new();
                trials.pick(usize::MAX, &mut picked);
                for owner in 0..owners.len() as u32 {
                    let here = picked.iter().filter(|point| point.owner == owner);
                    let here: Vec<_> = here.map(|point| (point.x, point.y, point.value)).collect();
                    let left: Vec<_> = left(owner).collect();
                    prop_assert_eq!(&here, &left, "{:?}", set);
                    let mut few = Vec::new();
                    trials.pick(most, &mut few);
                    few.retain(|point| point.owner == owner);
                    prop_assert_eq!(few.len(), left.len().min(most));
                    prop_assert!(few.iter().all(|point| left.contains(&(point.x, point.y, point.value))));
                }
                let found: Vec<usize> = trials.found().collect();
                let open: Vec<usize> = (0..owners.len()).filter(|&owner| owners[owner].1).collect();
                prop_assert_eq!(found, open);
            }
        }
    }
}

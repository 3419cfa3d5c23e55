//! Binding of budgets.

use super::arrays::{row_major, rows_of};
use super::interrupt;
use super::render::PyMesh;
use crate::bounds::Bounds;
use crate::error::Error;
use crate::placement::audit::{self, Audit, Backdrop, Group};
use crate::placement::cells::{Cells, Level, Span};
use crate::placement::count::{Boxes, Region};
use crate::placement::frame::{Answer, Plan};
use crate::placement::frustum::Field;
use crate::placement::gaze::Compass;
use crate::placement::image::Image;
use crate::placement::place::{Placed, Search, place};
use crate::placement::prove::{Leaf, Marked, Served, prove};
use crate::placement::stage::Stage;
use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

/// Images as arrays: viewpoints; yaw, pitch, distance and the four extents.
type ImageArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Leaves as arrays: eyes low and high, yaws and pitches; the image, -1 for none, -2 for a gap.
type LeafArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<i32>>);

type PlacedArrays<'py> = (ImageArrays<'py>, LeafArrays<'py>);

/// Where a budget is too small.
type Small = (u32, [f64; 3], f64, f64, usize);

/// The faces of a scene in cells.
#[pyclass(name = "Cells", frozen)]
pub struct PyCells {
    cells: Arc<Cells>,
    boxes: Arc<Boxes>,
    origin: DVec3,
    scale: f64,
}

impl PyCells {
    fn inside(&self, p: [f64; 3]) -> DVec3 {
        (DVec3::from(p) - self.origin) * self.scale
    }

    fn outside(&self, p: DVec3) -> DVec3 {
        p / self.scale + self.origin
    }
}

#[pymethods]
impl PyCells {
    /// `levels` are the ends of levels of detail among the faces, with the distances between which each is drawn;
    /// `regions` boxes of eyes, and `visible` a bit for each face, (R, W), that can be seen from each.
    #[new]
    #[pyo3(signature = (mesh, leaf_depth, levels=vec![], regions=vec![], visible=None))]
    fn new(
        py: Python<'_>,
        mesh: PyRef<'_, PyMesh>,
        leaf_depth: u32,
        levels: Vec<(u32, f64, f64)>,
        regions: Vec<[[f64; 3]; 2]>,
        visible: Option<PyReadonlyArray2<'_, u64>>,
    ) -> PyResult<Self> {
        let mesh = mesh.0.mesh();
        let (origin, scale) = (mesh.origin(), mesh.scale());
        let level = |(end, near, far)| Level { end, span: Span { near: near * scale, far: far * scale } };
        let levels: Vec<_> = levels.into_iter().map(level).collect();
        let faces = mesh.faces().len();
        if levels.last().is_some_and(|l| l.end as usize != faces) || !levels.is_sorted_by_key(|l| l.end) {
            return Err(PyValueError::new_err("the ends of levels must ascend to the number of faces"));
        }
        let place = |p: [f64; 3]| (DVec3::from(p) - origin) * scale;
        let bounds = regions.iter().map(|r| Bounds { low: place(r[0]), high: place(r[1]) });
        let regions: Vec<_> = match &visible {
            Some(visible) => {
                let words = faces.div_ceil(64);
                let bits = row_major("visible", visible)?;
                if bits.len() != regions.len() * words {
                    return Err(PyValueError::new_err("visible must have a row for each region"));
                }
                bounds.zip(bits.chunks(words)).map(|(b, w)| (b, w.to_vec())).collect()
            }
            None => Vec::new(),
        };
        let (cells, boxes) = interrupt::run(py, None, None, |_| {
            let cells = if levels.is_empty() {
                Cells::new(mesh, leaf_depth)
            } else {
                Cells::leveled(mesh, leaf_depth, &levels)
            };
            let boxes = Boxes::new(&cells);
            let boxes = if regions.is_empty() { boxes } else { boxes.with_visible(&cells, regions) };
            Ok((cells, boxes))
        })?;
        Ok(Self { cells: Arc::new(cells), boxes: Arc::new(boxes), origin, scale })
    }

    /// The faces, those of a cell one after another.
    fn order<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, self.cells.order())
    }

    /// For each node in the order of a walk: the first of its own faces in the order, and their end, and that of the
    /// subtree's, and the next node beside.
    fn nodes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let nodes = self.cells.nodes();
        let values = nodes.iter().flat_map(|n| [n.first, n.own_end, n.end, n.next]);
        PyArray1::from_iter(py, values).reshape([nodes.len(), 4])
    }

    /// Places images and proves them; or says where the budget is too small: how much is needed there, the eye, yaw and
    /// pitch in degrees, and with how many images that is so (0: with any).
    #[pyo3(signature = (options, threads=None, progress=None))]
    fn place<'py>(
        &self,
        py: Python<'py>,
        options: &Bound<'_, PyDict>,
        threads: Option<i64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(Option<PlacedArrays<'py>>, Option<Small>)> {
        let stage = self.stage(options)?;
        let number = |name: &str| option(options, name)?.extract::<f64>();
        let search = Search {
            spacing: number("spacing")?,
            margin: number("margin")?,
            state_edge: number("state_edge")?,
            state_turns: option(options, "state_turns")?.extract()?,
            most_leaves: option(options, "most_leaves")?.extract()?,
        };
        let mut small = None;
        let placed = interrupt::run(py, threads, progress, |control| match place(&stage, search, control) {
            Err(Error::TooSmallBudget { needed, eye, yaw, pitch, images, .. }) => {
                let eye = self.outside(DVec3::from(eye)).to_array();
                small = Some((needed, eye, yaw, pitch, images));
                Ok(None)
            }
            placed => placed.map(Some),
        })?;
        Ok((placed.map(|p| self.arrays(py, &p)).transpose()?, small))
    }

    /// What images serve, (I, 3) viewpoints beside (I, 7) yaw, pitch, distance and extents: leaves as of `place`, -2
    /// where none does or that could not be proved.
    #[pyo3(signature = (options, viewpoints, images, threads=None, progress=None))]
    fn prove<'py>(
        &self,
        py: Python<'py>,
        options: &Bound<'_, PyDict>,
        viewpoints: PyReadonlyArray2<'_, f64>,
        images: PyReadonlyArray2<'_, f64>,
        threads: Option<i64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<LeafArrays<'py>> {
        let stage = self.stage(options)?;
        let images = self.marked(&viewpoints, &images, &stage.compass)?;
        let least = option(options, "least")?.extract()?;
        let leaves = interrupt::run(py, threads, progress, |control| prove(&images, &stage, least, control))?;
        self.leaves(py, &leaves)
    }
}

/// An entry that must be there.
fn option<'py>(options: &Bound<'py, PyDict>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    options.get_item(name)?.ok_or_else(|| PyValueError::new_err(format!("{name} is missing")))
}

impl PyCells {
    fn stage(&self, options: &Bound<'_, PyDict>) -> PyResult<Stage<'_>> {
        let get = |name: &str| option(options, name);
        let number = |name: &str| get(name)?.extract::<f64>();
        let domain: [[f64; 3]; 2] = get("domain")?.extract()?;
        Ok(Stage {
            cells: &self.cells,
            boxes: &self.boxes,
            compass: Compass::new(DVec3::from(get("up")?.extract::<[f64; 3]>()?)),
            field: Field { tan_x: number("tan_x")?, tan_y: number("tan_y")? },
            extent: Field { tan_x: number("image_tan_x")?, tan_y: number("image_tan_y")? },
            budget: get("budget")?.extract()?,
            target: get("target")?.extract()?,
            domain: Bounds { low: self.inside(domain[0]), high: self.inside(domain[1]) },
            pitch: get("pitch")?.extract()?,
            aims: get("aims")?.extract()?,
            reach: number("reach")? * self.scale,
        })
    }

    /// Images from arrays, with what they cull.
    fn marked(
        &self,
        viewpoints: &PyReadonlyArray2<'_, f64>,
        images: &PyReadonlyArray2<'_, f64>,
        compass: &Compass,
    ) -> PyResult<Vec<Marked>> {
        let viewpoints = rows_of::<3, _, _>("viewpoints", viewpoints)?;
        let images = rows_of::<7, _, _>("images", images)?;
        if viewpoints.len() != images.len() {
            return Err(PyValueError::new_err("a viewpoint for each image"));
        }
        let image = |(&viewpoint, &[yaw, pitch, distance, a, b, c, d]): (&[f64; 3], &[f64; 7])| {
            let viewpoint = self.inside(viewpoint);
            let image = Image::new(viewpoint, (yaw, pitch), distance * self.scale, [a, b, c, d], compass);
            Marked { image, marks: image.marks(&self.cells) }
        };
        Ok(viewpoints.iter().zip(images).map(image).collect())
    }

    fn arrays<'py>(&self, py: Python<'py>, placed: &Placed) -> PyResult<PlacedArrays<'py>> {
        let n = placed.images.len();
        let viewpoints = placed.images.iter().flat_map(|i| self.outside(i.viewpoint).to_array());
        let rest = placed.images.iter().flat_map(|i| {
            let [a, b, c, d] = i.extent;
            [i.yaw, i.pitch, i.distance / self.scale, a, b, c, d]
        });
        Ok((
            (
                PyArray1::from_iter(py, viewpoints).reshape([n, 3])?,
                PyArray1::from_iter(py, rest).reshape([n, 7])?,
            ),
            self.leaves(py, &placed.leaves)?,
        ))
    }

    fn leaves<'py>(&self, py: Python<'py>, leaves: &[Leaf]) -> PyResult<LeafArrays<'py>> {
        let m = leaves.len();
        let boxes = leaves.iter().flat_map(|l| {
            let (low, high) =
                (self.outside(l.state.eyes.low).to_array(), self.outside(l.state.eyes.high).to_array());
            let (yaw, pitch) = (l.state.gazes.yaw, l.state.gazes.pitch);
            [low[0], low[1], low[2], high[0], high[1], high[2], yaw[0], yaw[1], pitch[0], pitch[1]]
        });
        let served = leaves.iter().map(|l| match l.served {
            Served::Bare => -1,
            Served::By(image) => image as i32,
            Served::Gap | Served::Open => -2,
        });
        Ok((PyArray1::from_iter(py, boxes).reshape([m, 10])?, PyArray1::from_iter(py, served)))
    }
}

/// A plan that answers frames.
#[pyclass(name = "Plan", frozen)]
pub struct PyPlan {
    plan: Plan,
    origin: DVec3,
    scale: f64,
    /// In the user's units.
    domain: Bounds,
}

impl PyPlan {
    /// What can be seen from where an eye in the user's units is.
    fn seen_from(&self, eye: DVec3) -> &Region {
        self.plan.boxes.region((eye - self.origin) * self.scale)
    }

    /// What an eye in the user's units draws.
    fn answer(&self, eye: DVec3, yaw: f64, pitch: f64, ranges: &mut Vec<Range<u32>>) -> Answer {
        let at = (eye - self.origin) * self.scale;
        if self.domain.contains(eye) {
            self.plan.frame(at, yaw, pitch, ranges)
        } else {
            self.plan.beyond(at, yaw, pitch, ranges)
        }
    }
}

#[pymethods]
impl PyPlan {
    /// `images` are yaw, pitch, distance and the four extents of each; the last `shell` are for eyes beyond the domain.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "one argument each in Python")]
    fn new(
        cells: &Bound<'_, PyCells>,
        viewpoints: PyReadonlyArray2<'_, f64>,
        images: PyReadonlyArray2<'_, f64>,
        shell: usize,
        domain: [[f64; 3]; 2],
        up: [f64; 3],
        tangents: [f64; 2],
        budget: u32,
    ) -> PyResult<Self> {
        let cells = cells.get();
        let compass = Compass::new(DVec3::from(up));
        let images = cells.marked(&viewpoints, &images, &compass)?;
        if shell > images.len() {
            return Err(PyValueError::new_err("no more images are in the shell than there are"));
        }
        let field = Field { tan_x: tangents[0], tan_y: tangents[1] };
        let (scene, boxes) = (cells.cells.clone(), cells.boxes.clone());
        let plan = Plan { cells: scene, boxes, compass, field, budget, images, shell };
        let domain = Bounds { low: domain[0].into(), high: domain[1].into() };
        Ok(Self { plan, origin: cells.origin, scale: cells.scale, domain })
    }

    /// The faces that an image stands for, in the order of the cells.
    fn culled<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let count = self.plan.images.len();
        let Some(marked) = self.plan.images.get(index) else {
            return Err(PyValueError::new_err(format!("index is {index}, the plan has {count} images")));
        };
        let cells = &self.plan.cells;
        let faces = marked.culled(cells).into_iter().flat_map(|range| &cells.order()[range]);
        Ok(PyArray1::from_iter(py, faces.copied()))
    }

    /// Writes the faces to draw to `out`; says how many they are and the image, -1 for none, -2 where none serves.
    fn frame(
        &self,
        py: Python<'_>,
        eye: [f64; 3],
        yaw: f64,
        pitch: f64,
        mut out: PyReadwriteArray1<'_, u32>,
    ) -> PyResult<(usize, i64)> {
        let out = out.as_slice_mut()?;
        interrupt::brief(py, None, move |_| {
            let mut ranges = Vec::new();
            let answer = self.answer(eye.into(), yaw, pitch, &mut ranges);
            let region = self.seen_from(eye.into());
            let mut count = 0;
            for range in ranges {
                let faces = &self.plan.cells.order()[range.start as usize..range.end as usize];
                if region.visible.is_empty() {
                    out[count..count + faces.len()].copy_from_slice(faces);
                    count += faces.len();
                } else {
                    for &face in faces.iter().filter(|f| region.sees(**f)) {
                        out[count] = face;
                        count += 1;
                    }
                }
            }
            let image = match answer {
                Answer::Bare => -1,
                Answer::Image(index) => index as i64,
                Answer::Nothing => -2,
            };
            Ok((count, image))
        })
    }

    /// Draws frames and has each looked at: how many faces, the image, what is wrong (lost, past, outside), the distance
    /// to the viewpoint. Gazes are (N, 3) directions beside (N, 2) yaws and pitches.
    #[pyo3(signature = (audit, starts, eyes, gazes, angles, threads=None, progress=None))]
    #[expect(clippy::too_many_arguments, reason = "one argument each in Python")]
    fn check<'py>(
        &self,
        py: Python<'py>,
        audit: &Bound<'_, PyAudit>,
        starts: PyReadonlyArray1<'_, i64>,
        eyes: PyReadonlyArray2<'_, f64>,
        gazes: PyReadonlyArray2<'_, f64>,
        angles: PyReadonlyArray2<'_, f64>,
        threads: Option<i64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<FrameArrays<'py>> {
        let eyes: Vec<DVec3> = rows_of::<3, _, _>("eyes", &eyes)?.iter().map(|&e| e.into()).collect();
        let gazes: Vec<DVec3> = rows_of::<3, _, _>("gazes", &gazes)?.iter().map(|&g| g.into()).collect();
        let angles = rows_of::<2, _, _>("angles", &angles)?;
        let starts = row_major("starts", &starts)?;
        let audit = &audit.get().0;
        if gazes.len() != eyes.len() || angles.len() != eyes.len() || starts.len() != audit.groups.len() {
            return Err(PyValueError::new_err("a gaze for each eye, a start for each group"));
        }
        let counts: Vec<_> = eyes.iter().map(|_| AtomicI64::new(0)).collect();
        let chosen: Vec<_> = eyes.iter().map(|_| AtomicI64::new(-1)).collect();
        let found = interrupt::run(py, threads, progress, |control| {
            audit::frames(audit, &eyes, &gazes, control, |index, drawn| {
                let mut ranges = Vec::new();
                let [yaw, pitch] = angles[index];
                let answer = self.answer(eyes[index], yaw, pitch, &mut ranges);
                let mut count = 0;
                let region = self.seen_from(eyes[index]);
                for range in &ranges {
                    let faces = &self.plan.cells.order()[range.start as usize..range.end as usize];
                    count += faces.iter().filter(|f| region.sees(**f)).count() as i64;
                    let first = starts.partition_point(|&s| s < i64::from(range.start));
                    for (group, drawn) in drawn.iter_mut().enumerate().skip(first) {
                        let end = starts[group] + i64::from(audit.groups[group].faces);
                        if end > i64::from(range.end) {
                            break;
                        }
                        *drawn = true;
                    }
                }
                counts[index].store(count, Ordering::Relaxed);
                let (image, code) = match answer {
                    Answer::Bare => (None, -1),
                    Answer::Image(image) => (Some(image), image as i64),
                    Answer::Nothing => (None, -2),
                };
                chosen[index].store(code, Ordering::Relaxed);
                Ok(image)
            })
        })?;
        let numbers =
            |from: Vec<AtomicI64>| PyArray1::from_iter(py, from.into_iter().map(AtomicI64::into_inner));
        let flags = found.iter().flat_map(|f| [f.lost, f.past, f.outside]);
        let flags = PyArray1::from_iter(py, flags).reshape([found.len(), 3])?;
        let distances = PyArray1::from_iter(py, found.iter().map(|f| f.distance));
        Ok((numbers(counts), numbers(chosen), flags, distances))
    }

    /// (I, 4, 3) corners of the quadrilaterals, and (I, 3) gazes of the images.
    fn images<'py>(&self, py: Python<'py>) -> PyResult<ImageArrays<'py>> {
        let n = self.plan.images.len();
        let corners = self.plan.images.iter().flat_map(|m| m.image.corners());
        let corners = corners.flat_map(|c| (c / self.scale + self.origin).to_array());
        let gazes = self.plan.images.iter().flat_map(|m| m.image.forward.to_array());
        Ok((
            PyArray1::from_iter(py, corners).reshape([4 * n, 3])?,
            PyArray1::from_iter(py, gazes).reshape([n, 3])?,
        ))
    }

    /// The yaw and pitch of a gaze.
    fn angles(&self, forward: [f64; 3]) -> (f64, f64) {
        self.plan.compass.angles(DVec3::from(forward))
    }
}

/// Faces, image (-1 for none, -2 where none serves), what is wrong, distance.
type FrameArrays<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray2<bool>>,
    Bound<'py, PyArray1<f64>>,
);

/// What a second opinion on a plan needs to know.
#[pyclass(name = "Audit", frozen)]
pub struct PyAudit(Audit);

#[pymethods]
impl PyAudit {
    /// (C, 3) boxes of groups of faces with (C,) counts; (I, 3) viewpoints, (4 I, 3) corners.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "one argument each in Python")]
    fn new(
        low: PyReadonlyArray2<'_, f64>,
        high: PyReadonlyArray2<'_, f64>,
        counts: PyReadonlyArray1<'_, u32>,
        viewpoints: PyReadonlyArray2<'_, f64>,
        corners: PyReadonlyArray2<'_, f64>,
        axes: [[f64; 3]; 3],
        tangents: [f64; 2],
        budget: u32,
        slack: f64,
        spans: PyReadonlyArray2<'_, f64>,
        regions: Vec<[[f64; 3]; 2]>,
        seen: PyReadonlyArray2<'_, u32>,
    ) -> PyResult<Self> {
        let spans = rows_of::<2, _, _>("spans", &spans)?;
        let seen = row_major("seen", &seen)?;
        let (low, high) = (rows_of::<3, _, _>("low", &low)?, rows_of::<3, _, _>("high", &high)?);
        let counts = row_major("counts", &counts)?;
        let viewpoints = rows_of::<3, _, _>("viewpoints", &viewpoints)?;
        let (corners, rest) = rows_of::<3, _, _>("corners", &corners)?.as_chunks::<4>();
        let same = low.len() == high.len() && low.len() == counts.len() && rest.is_empty();
        let whole = spans.len() == low.len() && seen.len() == regions.len() * low.len();
        if !same || !whole || corners.len() != viewpoints.len() {
            return Err(PyValueError::new_err(
                "a box and a count for each group, four corners for each image",
            ));
        }
        let group = |(index, (&low, &high)): (usize, (&[f64; 3], &[f64; 3]))| {
            let (low, high) = (DVec3::from(low), DVec3::from(high));
            let (faces, span) = (counts[index], spans[index]);
            Group { center: low.midpoint(high), half: (high - low) * 0.5, faces, span }
        };
        let rows = seen.chunks(low.len().max(1)).map(<[u32]>::to_vec);
        Ok(Self(Audit {
            groups: low.iter().zip(high).enumerate().map(group).collect(),
            regions: regions.iter().map(|r| r.map(DVec3::from)).zip(rows).collect(),
            backdrops: viewpoints
                .iter()
                .zip(corners)
                .map(|(&v, c)| Backdrop::new(v.into(), c.map(DVec3::from)))
                .collect(),
            axes: axes.map(DVec3::from),
            tangents,
            budget,
            slack,
        }))
    }

    /// Checks boxes, (L, 10), and the image of each.
    #[pyo3(signature = (boxes, images, domain, pitch, threads=None, progress=None))]
    #[expect(clippy::too_many_arguments, reason = "one argument each in Python")]
    fn proof(
        &self,
        py: Python<'_>,
        boxes: PyReadonlyArray2<'_, f64>,
        images: PyReadonlyArray1<'_, i32>,
        domain: [[f64; 3]; 2],
        pitch: [f64; 2],
        threads: Option<i64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let boxes = rows_of::<10, _, _>("boxes", &boxes)?;
        let images = row_major("images", &images)?;
        if images.len() != boxes.len() {
            return Err(PyValueError::new_err("an image for each box"));
        }
        let spans: Vec<_> = boxes
            .iter()
            .map(|b| [[b[0], b[3]], [b[1], b[4]], [b[2], b[5]], [b[6], b[7]], [b[8], b[9]]])
            .collect();
        let whole = audit::whole(domain[0].into(), domain[1].into(), pitch);
        interrupt::run(py, threads, progress, |control| self.0.proof(&spans, images, whole, control))
    }
}

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<PyPlan>()?;
    m.add_class::<PyAudit>()?;
    m.add_class::<PyCells>()
}

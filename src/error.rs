//! What can be wrong with an input, said with the values that were wrong.

/// Why a kernel refused its input.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A vertex coordinate is NaN or infinite.
    #[error("vertices[{index}] is {value:?}: coordinates must be finite")]
    NotFinite { index: usize, value: [f64; 3] },
    /// A face names a vertex that is not there.
    #[error("faces[{face}] names vertex {vertex}, the mesh has {count}")]
    UnknownVertex { face: usize, vertex: u64, count: usize },
    /// There is nothing to look at.
    #[error("the mesh is empty: {vertices} vertices, {faces} faces")]
    EmptyMesh { vertices: usize, faces: usize },
    /// All faces are points or segments.
    #[error("all {faces} faces of the mesh have zero area")]
    AllDegenerate { faces: usize },
    /// An eye sees so much at close range that no image can stand for it; the eye in the mesh's own units.
    #[error(
        "budget {budget} is too small: an eye at {eye:?} that looks along yaw {yaw:.4} and pitch {pitch:.4} degrees needs {needed} faces, those of cells about it, with the best of {images} images (0: with any)"
    )]
    TooSmallBudget { budget: u32, needed: u32, eye: [f64; 3], yaw: f64, pitch: f64, images: usize },
    /// Some other promise of an argument was broken; the text names the argument and the value.
    #[error("{0}")]
    Invalid(String),
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
}

//! Pictures with depth that stand in for geometry.

pub mod compose;
pub mod depth_mesh;
pub mod layered;
pub mod sample;
pub mod warp;

//! Pictures with depth that stand in for geometry.

pub mod layered;
pub mod warp;

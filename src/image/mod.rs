//! Pictures with depth that stand in for geometry.

pub mod warp;

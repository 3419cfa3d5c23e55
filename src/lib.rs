//! Cyclorama decides ahead of time what of a 3D scene can be seen from where.
//!
//! This crate holds the kernels: plain Rust on slices and small structs. The Python binding is
//! the `python` module, compiled with the feature of that name; nothing else here knows Python.
//!
//! # Conventions
//!
//! * World: right-handed, in the user's units. Angles are radians here, degrees in Python.
//! * Camera axes are OpenCV's: `+x` right, `+y` down, `+z` forward. Pixel `(x, y)` has its centre at
//!   `(x + 0.5, y + 0.5)` in the coordinates of `K`. Images are row-major, top row first.
//! * Depth is `z` along the viewing axis, in the user's units.
//! * A triangle is visible from a camera where some point of it, inside the image, is the nearest
//!   surface on its ray. Coincident triangles tie; the lowest index wins.
//! * A row of bits has `ceil(F / 64)` words; bit `k` of word `w` is triangle `64 w + k`.
//! * Results are the same bits for any number of threads.

pub mod adjacency;
pub mod bitfield;
pub mod bounds;
pub mod camera;
pub mod control;
pub mod error;
pub mod image;
pub mod mesh;
pub mod octree;
pub mod panorama;
pub mod patch;
pub mod placement;
pub mod portal;
pub mod render;
pub mod sphere;
pub mod visibility;

#[cfg(feature = "python")]
mod python;

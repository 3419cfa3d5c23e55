//! Spheres of viewpoints: where views are sampled, and which samples surround an eye.
//!
//! A sampling sphere is a closed triangulation of directions around the model's centre. A direction
//! belongs to the face whose *cone* holds it: the one that a ray from the centre passes through. What
//! counts is the sign of `a · (b × d)` for each edge `a → b`, which is computed exactly, so faces that
//! share an edge leave no gap, and lengths (of points and directions alike) do not matter.
//!
//! Faces wind counter-clockwise seen from outside. Edge `i` of a face runs from its corner `i` to the next.

pub mod cap;
pub mod cover;
pub mod direction;
pub mod fibonacci;
pub mod hull;
pub mod locate;
pub mod octahedron;
pub mod subdivide;
pub mod triangulation;

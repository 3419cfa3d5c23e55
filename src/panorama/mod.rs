//! Panoramas along a track: drawn ahead, split into slabs of range, freed of what the track never sees, and put together
//! again to views between them ("A Panoramic Walkthrough System with Occlusion Culling", Yang and Crawfis, 2003).
//!
//! A panorama's axes are `right`, `up` and `back`: its middle column looks along `-back`, columns to the right of it turn
//! to the right. *Range* is the distance from the viewpoint, *disparity* its inverse.

pub mod coding;
pub mod cull;
pub mod links;
pub mod projection;
pub mod quads;
pub mod render;
pub mod view;

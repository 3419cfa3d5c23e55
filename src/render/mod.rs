//! Id-buffers: which face is nearest at each sample of an image, and how far away.
//!
//! Two engines answer, a [rasteriser](raster) and a [ray caster](raycast). Both decide with the same
//! float64 arithmetic on the same projected vertices ([`triangle`]), so they agree to the last bit;
//! they differ only in how they find the faces worth asking. A pixel belongs to a face if its centre
//! does; that a face owns no pixel does not prove it hidden (it may fall between the centres), which
//! is what [`visible`] is about.

pub mod beam;
pub mod clusters;
pub mod confirm;
pub mod cost;
#[cfg(test)]
pub mod fixtures;
pub mod frame;
pub mod lanes;
pub mod multihit;
pub mod neighbours;
pub mod pyramid;
pub mod raster;
pub mod raycast;
pub mod rays;
pub mod scene;
pub mod seen;
pub mod selection;
pub mod shade;
pub mod stages;
pub mod triangle;
pub mod view;
pub mod visible;

/// Id stored where the ray leaves the scene.
pub const BACKGROUND: u32 = u32::MAX;

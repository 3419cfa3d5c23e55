//! Id-buffers: which face is nearest at each pixel centre, and how far away.

/// Id stored where the ray leaves the scene.
pub const BACKGROUND: u32 = u32::MAX;

//! Forward warping: pictures with depth, seen from where they were not taken (1998 dissertation, section 4.2).
//!
//! [`mapping`] says where samples fall, [`sheets`] in which order they may be drawn, [`canvas`] keeps the winner of each
//! pixel. [`forward`] puts them together for anything that has rows of samples, an
//! image with depth or a layered one; [`splats`] does for samples that cover as much as they appear to. [`fill`] guesses
//! at what no sample covers, as a step of its own.

pub mod canvas;
pub mod fill;
pub mod forward;
pub mod image;
pub mod mapping;
pub mod picture;
pub mod sheets;
pub mod splats;

//! What is visible from a region, learned from views of it.

pub mod probe;

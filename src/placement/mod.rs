//! Budgets: which part of a scene a picture replaces, so that what is drawn never exceeds a number of primitives
//! (Aliaga's dissertation of 1998, chapter 3).

pub mod cells;
pub mod directions;
pub mod frustum;
pub mod grid;
pub mod optimise;
pub mod paper;
pub mod star;

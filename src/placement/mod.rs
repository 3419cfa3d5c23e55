//! Budgets: which part of a scene a picture replaces, so that what is drawn never exceeds a number of primitives
//! (Aliaga's dissertation of 1998, chapter 3).

pub mod audit;
pub mod cells;
pub mod count;
pub mod cover;
pub mod directions;
pub mod frame;
pub mod frustum;
pub mod gaze;
pub mod grid;
pub mod image;
pub mod nearest;
pub mod optimise;
pub mod paper;
pub mod place;
pub mod prove;
pub mod stage;
pub mod star;
pub mod sweep;

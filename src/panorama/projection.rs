//! Which direction each pixel of a panorama looks in, and back.

use crate::error::Error;
use glam::{DMat3, DVec3, dvec3};
use std::f64::consts::{PI, TAU};

/// How directions become rows; columns are angles about the up axis for both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Rows are heights on a cylinder around the up axis. Pixels are square on the horizon: 4096 x 1024 see 76 degrees.
    Cylinder,
    /// Rows are angles, from straight up to straight down.
    Equirect,
}

/// The pixels of a panorama.
#[derive(Debug, Clone)]
pub struct Projection {
    pub kind: Kind,
    pub width: usize,
    pub height: usize,
    /// Columns right, up, back: from the panorama's axes to the world's.
    axes: DMat3,
    /// Sine and cosine of the angle at each column's left edge and middle, in turn.
    turns: Vec<(f64, f64)>,
    /// Of each row's upper edge and middle, in turn: how long a direction is along the horizon, and how high.
    tilts: Vec<(f64, f64)>,
}

/// The longest side of a panorama: corners of quads are kept in 16 bits.
pub const MAX_SIDE: usize = 1 << 15;

impl Projection {
    /// # Errors
    /// [`Error::Invalid`] for a size outside 8 to [`MAX_SIDE`], or axes that are no right-handed frame.
    pub fn new(kind: Kind, width: usize, height: usize, axes: DMat3) -> Result<Self, Error> {
        if !(8..=MAX_SIDE).contains(&width) || !(8..=MAX_SIDE).contains(&height) {
            return Err(Error::Invalid(format!(
                "size must be 8 to {MAX_SIDE} pixels a side, got {width} x {height}"
            )));
        }
        let error = axes.transpose() * axes - DMat3::IDENTITY;
        if !axes.is_finite()
            || error.to_cols_array().iter().any(|e| e.abs() > 1e-6)
            || axes.determinant() < 0.0
        {
            return Err(Error::Invalid(format!("axes must be a rotation, got {axes}")));
        }
        let turns =
            (0..=2 * width).map(|i| (TAU * (i as f64 / (2 * width) as f64 - 0.5)).sin_cos()).collect();
        let tilts = (0..=2 * height).map(|i| tilt(kind, width, height, i as f64 / 2.0)).collect();
        Ok(Self { kind, width, height, axes, turns, tilts })
    }

    /// A vector of the panorama's axes (right, up, back) in the world's.
    pub fn to_world(&self, local: DVec3) -> DVec3 {
        self.axes * local
    }

    /// Pixels that a radian takes on the horizon.
    pub fn focal(&self) -> f64 {
        self.width as f64 / TAU
    }

    /// Pixels that a radian takes around a unit direction, at most, whichever way.
    #[inline]
    pub fn density(&self, direction: DVec3) -> f64 {
        let high = direction.dot(self.axes.y_axis);
        let flat = (1.0 - high * high).max(1e-12);
        match self.kind {
            Kind::Cylinder => self.focal() / flat,
            Kind::Equirect => (self.focal() / flat.sqrt()).max(self.height as f64 / PI),
        }
    }

    /// The unit direction through the middle of a pixel.
    #[inline]
    pub fn through(&self, x: usize, y: usize) -> DVec3 {
        self.half(2 * x + 1, 2 * y + 1)
    }

    /// The unit direction of the upper left corner of a pixel; one past the last is the right or lower edge.
    #[inline]
    pub fn corner(&self, x: usize, y: usize) -> DVec3 {
        self.half(2 * x, 2 * y)
    }

    /// The unit direction of a place in halves of pixels from the upper left corner of the panorama: columns go round, rows
    /// end with it.
    #[inline]
    pub fn half_pixel(&self, x: isize, y: isize) -> DVec3 {
        let x = x.rem_euclid(2 * self.width as isize) as usize;
        self.half(x, y.clamp(0, 2 * self.height as isize) as usize)
    }

    #[inline]
    fn half(&self, x: usize, y: usize) -> DVec3 {
        let (sin, cos) = self.turns[x];
        let (flat, high) = self.tilts[y];
        self.axes * dvec3(sin * flat, high, -cos * flat)
    }

    /// Where a direction falls, in pixels from the upper left corner; rows may be beyond the panorama.
    #[inline]
    pub fn place(&self, direction: DVec3) -> [f64; 2] {
        let local = self.axes.transpose() * direction;
        let flat = local.x.hypot(local.z);
        let x = (local.x.atan2(-local.z) / TAU + 0.5) * self.width as f64;
        let middle = 0.5 * self.height as f64;
        let y = match self.kind {
            Kind::Cylinder => middle - self.focal() * local.y / flat.max(f64::MIN_POSITIVE),
            Kind::Equirect => middle - local.y.atan2(flat) / PI * self.height as f64,
        };
        [x, y]
    }
}

/// Cosine and sine of the elevation of a row.
fn tilt(kind: Kind, width: usize, height: usize, y: f64) -> (f64, f64) {
    let up = match kind {
        Kind::Cylinder => ((0.5 * height as f64 - y) * TAU / width as f64).atan(),
        Kind::Equirect => PI * (0.5 - y / height as f64),
    };
    (up.cos(), up.sin())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_pixel_lies_where_its_direction_falls(
            cylinder in prop::bool::ANY, x in 0_usize..64, y in 0_usize..32, angle in 0.0..6.0_f64,
        ) {
            let kind = if cylinder { Kind::Cylinder } else { Kind::Equirect };
            let axes = DMat3::from_axis_angle(dvec3(1.0, 2.0, 0.5).normalize(), angle);
            let panorama = Projection::new(kind, 64, 32, axes).unwrap();
            let direction = panorama.through(x, y);
            prop_assert!((direction.length() - 1.0).abs() < 1e-12);
            let at = panorama.place(direction * 3.0);
            prop_assert!((at[0] - x as f64 - 0.5).abs() < 1e-9 && (at[1] - y as f64 - 0.5).abs() < 1e-9);
        }
    }

    #[test]
    fn the_papers_panorama_sees_76_degrees() {
        let panorama = Projection::new(Kind::Cylinder, 4096, 1024, DMat3::IDENTITY).unwrap();
        let (top, bottom) = (panorama.corner(2048, 0), panorama.corner(2048, 1024));
        assert!((top.angle_between(bottom).to_degrees() - 76.3).abs() < 0.05);
        assert!(panorama.corner(2048, 512).abs_diff_eq(dvec3(0.0, 0.0, -1.0), 1e-12));
        assert!(panorama.corner(3072, 512).abs_diff_eq(dvec3(1.0, 0.0, 0.0), 1e-12));
    }
}

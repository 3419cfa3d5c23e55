//! Boxes along the axes.

use glam::DVec3;

/// The points between two corners, faces of the box included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    pub low: DVec3,
    pub high: DVec3,
}

impl Bounds {
    /// The box that holds nothing.
    pub const EMPTY: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    /// The least box that holds `points`.
    pub fn of(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self { low: b.low.min(p), high: b.high.max(p) })
    }

    /// The least box that holds both.
    pub fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    pub fn is_empty(&self) -> bool {
        self.low.cmpgt(self.high).any()
    }

    pub fn size(&self) -> DVec3 {
        self.high - self.low
    }

    pub fn center(&self) -> DVec3 {
        self.low * 0.5 + self.high * 0.5
    }

    /// Whether a point lies in the box or on it.
    pub fn contains(&self, point: DVec3) -> bool {
        point.cmpge(self.low).all() && point.cmple(self.high).all()
    }

    /// The corner that lies farthest along `direction`.
    pub fn farthest(&self, direction: DVec3) -> DVec3 {
        DVec3::select(direction.cmpge(DVec3::ZERO), self.high, self.low)
    }

    /// The eight corners; bit 0 of the index chooses x, bit 1 y, bit 2 z.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |axis: usize| if i >> axis & 1 == 1 { self.high[axis] } else { self.low[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn nothing_has_no_box() {
        assert!(Bounds::of([]).is_empty());
        assert!(!Bounds::of([DVec3::ZERO]).is_empty());
    }

    proptest! {
        #[test]
        fn the_farthest_corner_is_one_of_the_eight(
            a in prop::array::uniform3(-1.0..1.0_f64),
            b in prop::array::uniform3(-1.0..1.0_f64),
            d in prop::array::uniform3(-1.0..1.0_f64),
        ) {
            let bounds = Bounds::of([a.into(), b.into()]);
            let d = DVec3::from(d);
            let best = bounds.corners().iter().map(|c| c.dot(d)).fold(f64::NEG_INFINITY, f64::max);
            prop_assert_eq!(bounds.farthest(d).dot(d), best);
            prop_assert!(bounds.corners().iter().all(|&c| bounds.contains(c)));
        }
    }
}

//! Faces of a few pixels: a register of them at a time, pixel by pixel of their boxes.

use super::super::frame::Band;
use super::super::lanes::{Lanes, MOST_LANES};
use super::super::triangle::{EDGE_ON, KEY_RANGE};
use super::super::view::View;
use super::cluster::{Projected, SMALL};

/// Samples found while faces are tested, put into the image together.
///
/// Where each goes is only known lane by lane; gathered in a list they take one loop without surprises for the
/// processor.
pub struct Hits {
    count: usize,
    words: [u64; Self::ROOM],
    places: [u32; Self::ROOM],
}

impl Hits {
    /// What one batch of faces can find, and a register past the end.
    const ROOM: usize = (SMALL as usize * SMALL as usize + 1) * MOST_LANES;
}

impl Default for Hits {
    fn default() -> Self {
        Self { count: 0, words: [0; Self::ROOM], places: [0; Self::ROOM] }
    }
}

/// Several [`Triangle`](super::super::triangle::Triangle)s that lie before the eye's plane, a lane each.
pub struct Setup<L: Lanes> {
    pub edges: [[L; 3]; 3],
    pub least: [L; 3],
    pub plane: [L; 3],
    pub range: [L; 2],
    /// Those that are faces at all.
    pub good: L::Mask,
}

impl<L: Lanes> Setup<L> {
    /// As [`Triangle::new`](super::super::triangle::Triangle::new) does one.
    #[inline(always)]
    pub fn new<const PERSPECTIVE: bool>(corners: [[L; 4]; 3]) -> Self {
        let [[ax, ay, aw, p], [bx, by, bw, q], [cx, cy, cw, r]] = corners;
        let (a, b, c) = ([ax, ay, aw], [bx, by, bw], [cx, cy, cw]);
        let (side, other) = (minus(b, a), minus(c, a));
        let normal = cross(side, other);
        let det = dot(normal, a);
        let reach = dot(a, a).max(dot(b, b)).max(dot(c, c));
        let noise = L::splat(EDGE_ON).mul(dot(side, side).mul(dot(other, other)).mul(reach));
        let finite = L::splat(f64::INFINITY).gt(det.abs());
        let good = L::and(finite, det.mul(det).gt(noise));
        let edges = [turned(cross(b, c), det), turned(cross(c, a), det), turned(cross(a, b), det)];
        let least = [least(edges[0]), least(edges[1]), least(edges[2])];
        let range = [p.min(q).min(r), p.max(q).max(r)];
        let (plane, good) = if PERSPECTIVE {
            let inverse = L::splat(1.0).div(det);
            ([normal[0].mul(inverse), normal[1].mul(inverse), normal[2].mul(inverse)], good)
        } else {
            let m = cross([side[0], side[1], q.sub(p)], [other[0], other[1], r.sub(p)]);
            let zero = L::splat(0.0);
            let gx = zero.sub(m[0]).div(m[2]);
            let gy = zero.sub(m[1]).div(m[2]);
            let constant = p.sub(gx.mul(a[0])).sub(gy.mul(a[1]));
            ([gx, gy, constant], L::and(good, m[2].mul(m[2]).gt(zero)))
        };
        Self { edges, least, plane, range, good }
    }
}

/// Draws the small faces of a cluster.
#[inline(always)]
pub fn draw<L: Lanes, const PERSPECTIVE: bool>(
    view: &View,
    projected: &Projected,
    band: &mut Band<'_>,
    hits: &mut Hits,
) {
    let list = &projected.small;
    for at in (0..list.count).step_by(L::COUNT) {
        let real = L::mask((1_u32 << (list.count - at).min(L::COUNT)) - 1);
        // SAFETY: lists are padded by a register of entries, whose corners are vertices of the cluster.
        let (setup, cells, tags) = unsafe {
            let faces = list.corners.as_ptr().add(at);
            let vertices = projected.vertices.as_ptr();
            let corners =
                [L::gather(vertices, faces, 0), L::gather(vertices, faces, 1), L::gather(vertices, faces, 2)];
            let setup = Setup::<L>::new::<PERSPECTIVE>(corners);
            (setup, L::load_cells(list.cells.as_ptr().add(at)), L::tags(list.ids.as_ptr().add(at)))
        };
        let mask = L::and(setup.good, real);
        fill::<L, PERSPECTIVE>(view, &setup, mask, cells, tags, band, hits);
        hits.put(band);
    }
}

#[inline(always)]
fn fill<L: Lanes, const PERSPECTIVE: bool>(
    view: &View,
    setup: &Setup<L>,
    mask: L::Mask,
    cells: [L; 4],
    tags: L::Words,
    band: &Band<'_>,
    hits: &mut Hits,
) {
    let [left, top, right, bottom] = cells;
    let zero = L::splat(0.0);
    // Pixels from the first to the last.
    let wide = zero.sub(left.add(right));
    let high = zero.sub(top.add(bottom));
    let none = L::splat(-1.0);
    let columns = L::select(mask, wide, none).greatest() as i32 + 1;
    let rows = L::select(mask, high, none).greatest() as i32 + 1;
    let seen = view.seen();
    let (low, most) = (L::splat(seen[0]), L::splat(seen[1]));
    let all_seen = L::bits(L::and(setup.range[0].ge(low), most.ge(setup.range[1]))) == (1 << L::COUNT) - 1;
    let keys = [L::splat(KEY_RANGE[0]), L::splat(KEY_RANGE[1])];
    let mut range = setup.range;
    if all_seen {
        range = [range[0].max(keys[0]).min(keys[1]), range[1].max(keys[0]).min(keys[1])];
    }
    let x = left.add(L::splat(view.column(0)));
    let mut y = top.add(L::splat(view.row(0)));
    let first_row = L::splat(band.rows.start as f64);
    let mut place = top.sub(first_row).mul(L::splat(band.stride as f64)).add(left);
    let (one, stride) = (L::splat(1.0), L::splat(band.stride as f64));
    let [e0, e1, e2] = &setup.edges;
    for row in 0..rows {
        let in_row = L::and(mask, high.ge(L::splat(f64::from(row))));
        let c0 = e0[1].mul(y).add(e0[2]);
        let c1 = e1[1].mul(y).add(e1[2]);
        let c2 = e2[1].mul(y).add(e2[2]);
        let constant = setup.plane[1].mul(y).add(setup.plane[2]);
        let (mut x, mut at) = (x, place);
        for column in 0..columns {
            let mut covered = L::and(in_row, wide.ge(L::splat(f64::from(column))));
            covered = L::and(covered, e0[0].mul(x).add(c0).ge(setup.least[0]));
            covered = L::and(covered, e1[0].mul(x).add(c1).ge(setup.least[1]));
            covered = L::and(covered, e2[0].mul(x).add(c2).ge(setup.least[2]));
            let value = setup.plane[0].mul(x).add(constant).max(range[0]).min(range[1]);
            if all_seen {
                hits.add::<L, PERSPECTIVE>(covered, value, tags, at);
            } else {
                let covered = L::and(covered, L::and(value.ge(low), most.ge(value)));
                hits.add::<L, PERSPECTIVE>(covered, value.max(keys[0]).min(keys[1]), tags, at);
            }
            x = x.add(one);
            at = at.add(one);
        }
        y = y.add(one);
        place = place.add(stride);
    }
}

impl Hits {
    #[inline(always)]
    fn add<L: Lanes, const PERSPECTIVE: bool>(&mut self, mask: L::Mask, value: L, tags: L::Words, place: L) {
        debug_assert!(self.count + L::COUNT <= Self::ROOM);
        // SAFETY: a batch adds at most SMALL x SMALL registers, and what it added is put into the image after it: with
        // ROOM for one register more, there is room for this.
        unsafe {
            let words = self.words.as_mut_ptr().add(self.count);
            let places = self.places.as_mut_ptr().add(self.count);
            L::append(mask, L::words::<PERSPECTIVE>(value, tags), place, words, places);
        }
        self.count += L::bits(mask).count_ones() as usize;
    }

    /// Puts what was found into the image.
    #[inline(always)]
    fn put(&mut self, band: &mut Band<'_>) {
        let samples = &mut *band.samples;
        for (&word, &place) in self.words[..self.count].iter().zip(&self.places[..self.count]) {
            let sample = &mut samples[place as usize];
            *sample = word.max(*sample);
        }
        self.count = 0;
    }
}

#[inline(always)]
fn minus<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0].sub(b[0]), a[1].sub(b[1]), a[2].sub(b[2])]
}

#[inline(always)]
fn dot<L: Lanes>(a: [L; 3], b: [L; 3]) -> L {
    a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
}

#[inline(always)]
fn cross<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [
        a[1].mul(b[2]).sub(b[1].mul(a[2])),
        a[2].mul(b[0]).sub(b[2].mul(a[0])),
        a[0].mul(b[1]).sub(b[0].mul(a[1])),
    ]
}

/// Turned where the determinant is negative.
#[inline(always)]
fn turned<L: Lanes>(n: [L; 3], det: L) -> [L; 3] {
    [n[0].times_sign_of(det), n[1].times_sign_of(det), n[2].times_sign_of(det)]
}

/// What an edge function must reach, by the sign of its normal.
#[inline(always)]
fn least<L: Lanes>(n: [L; 3]) -> L {
    let zero = L::splat(0.0);
    let y = L::or(n[1].gt(zero), L::and(n[1].eq(zero), n[2].gt(zero)));
    let owns = L::or(n[0].gt(zero), L::and(n[0].eq(zero), y));
    L::select(owns, zero, L::splat(f64::from_bits(1)))
}

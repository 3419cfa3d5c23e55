//! Faces of a few pixels, once a [sieve](super::sieve) has found which: their depths, a register of faces at a time.

use super::super::clusters::MOST_FACES;
use super::super::frame::Band;
use super::super::lanes::{Lanes, MOST_LANES, TABLE};
use super::super::triangle::{EDGE_ON, KEY_RANGE};
use super::super::view::{Vertex, View};
use super::sieve::{SMALL, Shown};

/// Samples found while the faces of a cluster are drawn, put into the image together.
///
/// Neighbours share registers of the image: what one wrote the next would wait for. Gathered in a list they take one loop
/// without surprises for the processor.
pub struct Hits {
    count: usize,
    words: [u64; Self::ROOM],
    places: [u32; Self::ROOM],
}

impl Hits {
    /// What a cluster's faces can find, and a register past the end.
    const ROOM: usize = MOST_FACES * SMALL * SMALL + MOST_LANES;

    /// Appends the words whose bits are set, `steps` from `place` on.
    #[inline(always)]
    fn add<L: Lanes>(&mut self, bits: u32, words: L::Words, place: u32, steps: &[u32; MOST_LANES]) {
        debug_assert!(self.count + L::COUNT <= Self::ROOM);
        // SAFETY: a cluster has at most MOST_FACES faces, a face adds at most SMALL x SMALL samples, and what is there is
        // put into the image after each cluster: with ROOM for one register more, there is room for this.
        unsafe {
            let words_to = self.words.as_mut_ptr().add(self.count);
            let places_to = self.places.as_mut_ptr().add(self.count);
            L::append(bits, words, place, steps.as_ptr(), words_to, places_to);
        }
        self.count += bits.count_ones() as usize;
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

/// Draws the faces that a sieve has left.
#[inline(always)]
pub fn draw<L: Lanes, const PERSPECTIVE: bool>(
    view: &View,
    vertices: &[Vertex; TABLE],
    shown: &Shown,
    band: &mut Band<'_>,
    hits: &mut Hits,
) {
    let seen = view.seen();
    let (low, most) = (L::splat(seen[0]), L::splat(seen[1]));
    // A register holds so many lines of pixels.
    let lines = L::COUNT / SMALL;
    // SAFETY: the array holds the lanes of any register.
    let columns = unsafe { L::load([0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0].as_ptr()) };
    let mut steps = [[0; MOST_LANES]; SMALL];
    for (line, steps) in steps.iter_mut().enumerate() {
        for (lane, step) in steps.iter_mut().enumerate() {
            *step = ((line + lane / SMALL) * band.stride + lane % SMALL) as u32;
        }
    }
    let keys = [L::splat(KEY_RANGE[0]), L::splat(KEY_RANGE[1])];
    for at in (0..shown.count).step_by(L::COUNT) {
        let count = (shown.count - at).min(L::COUNT);
        let real = (1_u32 << count) - 1;
        // SAFETY: what is shown is padded by a register of entries, whose corners are vertices of the cluster or, at
        // worst, others that there is room for.
        let (corners, top, tags) = unsafe {
            let faces = shown.corners[at..at + L::COUNT].as_ptr();
            let vertices = vertices.as_ptr();
            let a = L::gather(vertices, faces, 0);
            let b = L::gather(vertices, faces, 1);
            let c = L::gather(vertices, faces, 2);
            let top = L::load_f32(shown.rows[at..at + L::COUNT].as_ptr());
            ([a, b, c], top, L::tags(shown.ids[at..at + L::COUNT].as_ptr()))
        };
        let Setup { plane, mut range, good, .. } = Setup::<L>::new::<PERSPECTIVE>(corners);
        let in_sight = L::bits(L::and(range[0].ge(low), most.ge(range[1])));
        let all_seen = in_sight & real == real;
        if all_seen {
            range = [range[0].max(keys[0]).min(keys[1]), range[1].max(keys[0]).min(keys[1])];
        }
        // The constants of the rows of each face.
        let mut constants = [[0.0; MOST_LANES]; SMALL];
        let mut y = top.add(L::splat(view.row(0)));
        for constants in &mut constants {
            // SAFETY: the arrays hold the lanes of any register.
            unsafe { plane[1].mul(y).add(plane[2]).store(constants.as_mut_ptr()) };
            y = y.add(L::splat(1.0));
        }
        let (slopes, nearest, farthest) = (lanes(plane[0]), lanes(range[1]), lanes(range[0]));
        let mut words = [0; MOST_LANES];
        // SAFETY: the array holds the lanes of any register.
        unsafe { L::store_words(tags, words.as_mut_ptr()) };
        // Of faces that are none no pixel is drawn.
        let good = L::bits(good) & real;
        for lane in 0..count {
            let tags = L::splat_word(words[lane]);
            let range = [L::splat(farthest[lane]), L::splat(nearest[lane])];
            let column = shown.columns[at + lane] as usize;
            let along = L::splat(slopes[lane]).mul(columns.add(L::splat(view.column(column))));
            let pixels = shown.pixels[at + lane] & (good >> lane & 1).wrapping_neg();
            let place = shown.places[at + lane];
            for line in (0..SMALL).step_by(lines) {
                let mut bits = pixels >> (SMALL * line) & ((1 << L::COUNT) - 1);
                let (low_line, high_line) = (&constants[line], &constants[line + lines - 1]);
                let value = along.add(L::halves(low_line[lane], high_line[lane]));
                let mut value = value.max(range[0]).min(range[1]);
                if !all_seen {
                    bits &= L::bits(L::and(value.ge(low), most.ge(value)));
                    value = value.max(keys[0]).min(keys[1]);
                }
                hits.add::<L>(bits, L::words::<PERSPECTIVE>(value, tags), place, &steps[line]);
            }
        }
    }
    hits.put(band);
}

#[inline(always)]
fn lanes<L: Lanes>(register: L) -> [f64; MOST_LANES] {
    let mut lanes = [0.0; MOST_LANES];
    // SAFETY: the array holds the lanes of any register.
    unsafe { register.store(lanes.as_mut_ptr()) };
    lanes
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

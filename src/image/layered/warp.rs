//! Layered images seen from elsewhere, and what of them need not be looked at because it is hidden.
//!
//! Samples are drawn tile by tile in occlusion-compatible order ([`tiles`](super::tiles)), each on the pixel that its centre
//! falls on. That order is exact for points; samples fall on pixels, and where two of one pixel come in the wrong order
//! because their lines through the epipole differ, [`Order::Depth`] keeps the nearer.
//!
//! *What is hidden.* With [`Cull::Exact`] all is drawn the other way round, front to back, and what comes first stays: the
//! same picture, or, with a depth buffer, one that depends on no order at all. Samples of a tile that can't change it any
//! more ([`hidden`](super::hidden)) are left out. Then pixels are emptied in which something shines through a crack of
//! something nearer ([`cracks`](super::cracks)).

use super::Layered;
use super::cracks::open_cracks;
use super::hidden::Covered;
use super::tile_map::{BATCH, Fallen, Place, TileMap};
use super::tiles::{Chunk, SIDE, Tiles, order};
use super::view::{First, Last, Nearer, Rule, View};
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Error;
use crate::image::warp::canvas::{Canvas, Order, word};
use crate::image::warp::mapping::Mapping;
use crate::image::warp::picture::{Background, Picture};
use crate::render::lanes::{InstructionSet, Kernel, Lanes};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Rows that are drawn, and in which is looked up, by themselves where hidden samples are left out: so few that two
/// threads have as much to do on small pictures, and always the same, so that what is left out is.
const CULLING_ROWS: usize = 192;

/// What is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cull {
    /// Only what falls beside the image.
    Outside,
    /// What cannot change the picture.
    Exact,
}

/// What became of the samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Fates {
    pub drawn: usize,
    /// Left out: hidden.
    pub hidden: usize,
    /// Left out: beside the image, or behind the eye.
    pub outside: usize,
}

/// How a warp is done.
#[derive(Debug, Clone, Copy)]
pub struct Manner {
    pub order: Order,
    /// A sample covers `2 radius + 1` pixels each way.
    pub radius: usize,
    pub cull: Cull,
}

/// Warps a layered image into a picture of the `target` camera. `tiles` are those of the image.
///
/// # Errors
/// [`Error::Invalid`] for cameras that can't be warped, or a picture of another size; [`Error::Interrupted`].
pub fn warp(
    layered: &Layered,
    tiles: &Tiles,
    target: &Camera,
    manner: Manner,
    background: Background<'_>,
    mut picture: Picture<'_>,
    control: &Control,
) -> Result<Fates, Error> {
    target.check()?;
    let (width, height) = (target.width, target.height);
    picture.check(width * height)?;
    if let Background::Picture(behind) = background
        && behind.len() != width * height
    {
        return Err(Error::Invalid(format!(
            "background has {} pixels, the camera {width} x {height}",
            behind.len()
        )));
    }
    let mut canvas = Canvas::new(width, height);
    let fates = draw(layered, tiles, target, manner, &mut canvas, control)?;
    let set = InstructionSet::best();
    let threads = rayon::current_num_threads();
    let rows = if threads == 1 { height } else { height.div_ceil(2 * threads) };
    let canvas = &canvas;
    let part = |top: usize, picture: &mut Picture<'_>| {
        let background = match background {
            Background::Picture(behind) => Background::Picture(&behind[top * width..]),
            other => other,
        };
        set.run(Resolve { canvas, top, radius: manner.radius, background, picture });
    };
    if rows == height {
        part(0, &mut picture);
    } else {
        let parts = picture.parts(rows * width);
        parts.into_par_iter().enumerate().for_each(|(band, mut picture)| part(band * rows, &mut picture));
    }
    Ok(fates)
}

/// In how many pictures of some cameras each sample is shown by its own pixel, or in a radius of 0 would be if no cracks
/// were opened.
///
/// # Errors
/// As [`warp`].
pub fn shown(
    layered: &Layered,
    targets: &[Camera],
    order: Order,
    radius: usize,
    control: &Control,
) -> Result<Vec<u32>, Error> {
    let tiles = Tiles::new(layered, |sample| layered.colors()[sample] & COLOR);
    let indices = Tiles::new(layered, |sample| sample as u32).payload;
    let manner = Manner { order, radius, cull: Cull::Outside };
    let mut counts = vec![0; layered.len()];
    for target in targets {
        target.check()?;
        let mut canvas = Canvas::new(target.width, target.height);
        draw(layered, &tiles, target, manner, &mut canvas, control)?;
        let mapping = Mapping::new(layered.camera(), target)?;
        for words in canvas.bands(target.height) {
            let window = View { words, width: target.width, top: 0 };
            InstructionSet::best().run(Claim {
                tiles: &tiles,
                mapping: &mapping,
                window,
                indices: &indices,
                counts: &mut counts,
            });
        }
    }
    Ok(counts)
}

/// The bits of a sample's word that are its colour.
pub const COLOR: u32 = 0xFF_FFFF;

/// Finds the samples that a canvas shows: the first drawn of those that are the same there.
struct Claim<'a> {
    tiles: &'a Tiles,
    mapping: &'a Mapping,
    window: View<'a>,
    indices: &'a [u32],
    counts: &'a mut [u32],
}

impl Kernel for Claim<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { tiles, mapping, window, indices, counts } = self;
        let mut fallen = Fallen::default();
        for row in 0..tiles.rows {
            for column in 0..tiles.columns {
                let map = TileMap::new(mapping, column, row);
                for chunk in &tiles.chunks[tiles.of_tile(column, row)] {
                    map.project::<false>(tiles, chunk.samples(), &window, &mut fallen);
                    for (i, at) in chunk.samples().enumerate() {
                        let cell = fallen.cells()[i] as usize;
                        let shown = cell != window.width
                            && window.words[cell] == word(fallen.nearness[i], tiles.payload[at]);
                        if shown {
                            window.words[cell] = 0;
                            counts[indices[at] as usize] += 1;
                        }
                    }
                }
            }
        }
    }
}

/// Draws what [`warp`] shows onto a canvas; cracks are empty in it.
///
/// # Errors
/// As [`warp`].
pub fn draw(
    layered: &Layered,
    tiles: &Tiles,
    target: &Camera,
    manner: Manner,
    canvas: &mut Canvas,
    control: &Control,
) -> Result<Fates, Error> {
    let culls = manner.cull == Cull::Exact;
    let mapping = Mapping::new(layered.camera(), target)?;
    let (width, height) = (target.width, target.height);
    let threads = rayon::current_num_threads();
    let rows = match (culls, threads) {
        (true, _) => CULLING_ROWS,
        (false, 1) => height,
        (false, _) => height.div_ceil(2 * threads),
    };
    let plan = Plan {
        tiles,
        mapping: &mapping,
        columns: order(&mapping, 0, tiles.columns),
        rows: order(&mapping, 1, tiles.rows),
        manner,
        size: [width, height],
        fates: if culls { tiles.chunks.iter().map(|_| Fate::default()).collect() } else { Vec::new() },
    };
    let set = InstructionSet::best();
    canvas.bands(rows).enumerate().par_bridge().try_for_each(|(band, words)| {
        set.run(Draw { plan: &plan, window: View { words, width, top: band * rows }, control })
    })?;
    if manner.radius > 0 {
        open_cracks(canvas, rows);
    }
    let mut fates = Fates::default();
    for (chunk, fate) in tiles.chunks.iter().zip(&plan.fates) {
        let count = chunk.samples().len();
        if fate.drawn.load(Ordering::Relaxed) {
            fates.drawn += count;
        } else if fate.hidden.load(Ordering::Relaxed) {
            fates.hidden += count;
        } else {
            fates.outside += count;
        }
    }
    if !culls {
        fates.drawn = layered.len();
    }
    Ok(fates)
}

/// What became of a chunk in any band.
#[derive(Default)]
struct Fate {
    hidden: AtomicBool,
    drawn: AtomicBool,
}

/// What becomes of samples in a band.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Outside,
    Hidden,
    Drawn,
}

impl Fate {
    /// Bands set what holds for them: no order among them matters.
    #[inline(always)]
    fn set(&self, verdict: Verdict) {
        match verdict {
            Verdict::Outside => {}
            Verdict::Hidden => self.hidden.store(true, Ordering::Relaxed),
            Verdict::Drawn => self.drawn.store(true, Ordering::Relaxed),
        }
    }
}

/// What all bands share.
struct Plan<'a> {
    tiles: &'a Tiles,
    mapping: &'a Mapping,
    /// Tiles back to front.
    columns: Vec<usize>,
    rows: Vec<usize>,
    manner: Manner,
    size: [usize; 2],
    /// Of each chunk.
    fates: Vec<Fate>,
}

struct Draw<'a, 'b> {
    plan: &'a Plan<'a>,
    window: View<'b>,
    control: &'a Control,
}

impl Kernel for Draw<'_, '_> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Result<(), Error> {
        let Self { plan, mut window, control } = self;
        window.words.fill(0);
        let mut fallen = Fallen::default();
        let mut covered = Covered::new(&window);
        let culls = plan.manner.cull == Cull::Exact;
        for i in 0..plan.rows.len() {
            let row = plan.rows[if culls { plan.rows.len() - 1 - i } else { i }];
            for j in 0..plan.columns.len() {
                let column = plan.columns[if culls { plan.columns.len() - 1 - j } else { j }];
                let chunks = plan.tiles.of_tile(column, row);
                if chunks.is_empty() {
                    continue;
                }
                let map = TileMap::new(plan.mapping, column, row);
                if culls {
                    plan.front_to_back(&map, chunks, &mut window, &mut covered, &mut fallen);
                } else {
                    plan.back_to_front(&map, chunks, &mut window, &mut fallen);
                }
            }
            control.step(1)?;
        }
        Ok(())
    }
}

impl Plan<'_> {
    #[inline(always)]
    fn back_to_front(
        &self,
        map: &TileMap<'_>,
        chunks: Range<usize>,
        window: &mut View<'_>,
        fallen: &mut Fallen,
    ) {
        let whole = self.whole(&chunks);
        let seen = match map.place(self.tiles, &whole, window) {
            Place::Outside => return,
            Place::Within(reach) => reach.seen,
            Place::Anywhere => false,
        };
        let Range { start, end } = whole.samples();
        let behind = self.behind(start..end);
        for (samples, backward) in [(start..behind, false), (behind..end, true)] {
            self.put::<Last>(map, samples, window, fallen, backward, seen);
        }
    }

    /// All chunks of a tile as one.
    #[inline(always)]
    fn whole(&self, chunks: &Range<usize>) -> Chunk {
        self.tiles.chunks[chunks.end - 1].and_before(self.tiles.chunks[chunks.start].start)
    }

    /// The first of some samples of a tile that is behind the plane of the new eye, as the source sees it.
    #[inline(always)]
    fn behind(&self, samples: std::ops::Range<usize>) -> usize {
        let z = self.mapping.epipole.z;
        let disparities = &self.tiles.disparities[samples.clone()];
        // Most tiles have none: one look at the nearest tells.
        if disparities.last().is_none_or(|&d| f64::from(d) * z <= 1.0) {
            return samples.end;
        }
        samples.start + disparities.partition_point(|&d| f64::from(d) * z <= 1.0)
    }

    /// Draws a tile's chunks in the reverse of that order, until the rest of it is hidden.
    #[inline(always)]
    fn front_to_back(
        &self,
        map: &TileMap<'_>,
        chunks: Range<usize>,
        window: &mut View<'_>,
        covered: &mut Covered,
        fallen: &mut Fallen,
    ) {
        let all = &self.tiles.chunks[chunks.clone()];
        let fates = &self.fates[chunks.clone()];
        let whole = self.whole(&chunks);
        let mark = |fates: &[Fate], verdict| fates.iter().for_each(|fate| fate.set(verdict));
        let seen = match self.left_out(map, &whole, window, covered) {
            Ok(seen) => seen,
            Err(why) => return mark(fates, why),
        };
        let behind = self.behind(whole.samples());
        if behind < whole.end as usize {
            for (chunk, fate) in all.iter().zip(fates).filter(|(chunk, _)| chunk.end as usize > behind) {
                let part = Chunk { start: chunk.start.max(behind as u32), ..*chunk };
                let why = self.left_out(map, &part, window, covered).err();
                if why.is_none() {
                    self.put::<First>(map, part.samples(), window, fallen, false, seen);
                }
                fate.set(why.unwrap_or(Verdict::Drawn));
            }
        }
        let mut left = all.partition_point(|chunk| (chunk.start as usize) < behind);
        // What comes first is seldom hidden if not all of the tile is: it is drawn without asking.
        let (run, mut asks) = (behind as u32, false);
        while left > 0 {
            left -= 1;
            let chunk = Chunk { end: all[left].end.min(behind as u32), ..all[left] };
            if !asks {
                fates[left].set(Verdict::Drawn);
                asks = left == 0 || run - chunk.start >= SURFACE;
                if asks {
                    self.put::<First>(map, chunk.start as usize..run as usize, window, fallen, true, seen);
                }
                continue;
            }
            let why = self.left_out(map, &chunk, window, covered).err();
            fates[left].set(why.unwrap_or(Verdict::Drawn));
            if why.is_none() {
                self.put::<First>(map, chunk.samples(), window, fallen, true, seen);
            } else if left > 0
                && let rest = all[left - 1].and_before(whole.start)
                && let Err(why) = self.left_out(map, &rest, window, covered)
            {
                return mark(&fates[..left], why);
            }
        }
    }

    /// Draws samples of a tile: in turn, or the last first. In occlusion-compatible order `R` says which is shown.
    #[inline(always)]
    fn put<R: Rule>(
        &self,
        map: &TileMap<'_>,
        samples: Range<usize>,
        window: &mut View<'_>,
        fallen: &mut Fallen,
        backward: bool,
        seen: bool,
    ) {
        let Range { mut start, mut end } = samples;
        while start < end {
            let part = if backward {
                end.saturating_sub(BATCH).max(start)..end
            } else {
                start..end.min(start + BATCH)
            };
            match self.manner.order {
                Order::Depth => window.put::<Nearer>(map, self.tiles, part.clone(), fallen, backward, seen),
                Order::Occlusion => window.put::<R>(map, self.tiles, part.clone(), fallen, backward, seen),
            }
            if backward { end = part.start } else { start = part.end }
        }
    }

    /// Whether samples are known to be seen ([`Reach::seen`](super::tile_map::Reach::seen)), or why they need not be drawn.
    #[inline(always)]
    fn left_out(
        &self,
        map: &TileMap<'_>,
        chunk: &Chunk,
        window: &View<'_>,
        covered: &mut Covered,
    ) -> Result<bool, Verdict> {
        match map.place(self.tiles, chunk, window) {
            Place::Outside => Err(Verdict::Outside),
            Place::Within(reach) => {
                let hidden = match self.manner.order {
                    Order::Depth => window.hides(&reach, self.size, self.manner.radius > 0),
                    Order::Occlusion => covered.covers(window, &reach),
                };
                if hidden { Err(Verdict::Hidden) } else { Ok(reach.seen) }
            }
            Place::Anywhere => Ok(false),
        }
    }
}

/// Samples of a tile that are drawn at first, before it is asked whether more of it is hidden.
const SURFACE: u32 = (SIDE * SIDE) as u32;

/// Writes rows of the picture.
struct Resolve<'a, 'b, 'c> {
    canvas: &'a Canvas,
    top: usize,
    radius: usize,
    background: Background<'a>,
    picture: &'c mut Picture<'b>,
}

impl Kernel for Resolve<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        self.picture.resolve::<L, _>(self.canvas, self.top, self.radius, self.background);
    }
}

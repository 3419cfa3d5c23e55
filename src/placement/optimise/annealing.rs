//! Simulated annealing over the borders: what section 3.6.2 proposes against local optima.

use super::{BORDERS, Solution, View};

/// Temperatures at the first and the last step, in units of the cost-benefit function: the first takes steps that lose a
/// few percent, the last hardly any that loses at all.
const HOT: f64 = 0.03;
const COLD: f64 = 1e-4;

/// What it costs to leave all primitives too many: more than any subset is worth.
const PENALTY: f64 = 4.0;

/// Anneals for `steps` steps; the same seed finds the same subset. `None` if none that it met replaces enough.
pub fn anneal(view: &View, steps: usize, seed: u64) -> Option<Solution> {
    let last: [u32; BORDERS] =
        std::array::from_fn(|b| view.items.iter().map(|i| i.ranks[b]).max().unwrap_or(0));
    let mut random = Random(seed);
    let mut at = [0; BORDERS];
    let mut worth = penalised(view, &members(view, at));
    let mut best: Option<(f64, Vec<u32>)> = None;
    for step in 0..steps {
        let temperature = HOT * (COLD / HOT).powf(step as f64 / steps as f64);
        let border = (random.unit() * BORDERS as f64) as usize;
        // Steps of all sizes, most of them small: a power of the list's length.
        let far = f64::from(last[border] + 1).powf(random.unit()) as i64;
        let way = if random.unit() < 0.5 { -far } else { far };
        let mut next = at;
        next[border] = (i64::from(at[border]) + way).clamp(0, last[border].into()) as u32;
        let subset = members(view, next);
        let gain = penalised(view, &subset) - worth;
        if gain >= 0.0 || random.unit() < (gain / temperature).exp() {
            (at, worth) = (next, worth + gain);
            if view.count(&subset) >= view.need() && best.as_ref().is_none_or(|b| worth > b.0) {
                best = Some((worth, subset));
            }
        }
    }
    view.solution(&best?.1, f64::INFINITY, steps)
}

/// The subset with these limits.
fn members(view: &View, limits: [u32; BORDERS]) -> Vec<u32> {
    let inside = |ranks: &[u32; BORDERS]| (0..BORDERS).all(|b| ranks[b] >= limits[b]);
    (0..view.items.len() as u32).filter(|&m| inside(&view.items[m as usize].ranks)).collect()
}

/// The value of a subset, less what it leaves too many.
fn penalised(view: &View, members: &[u32]) -> f64 {
    let short = view.need().saturating_sub(view.count(members)) as f64 / view.total.max(1) as f64;
    let value = if members.is_empty() { 0.0 } else { view.value_of(members) };
    value - PENALTY * short
}

/// Numbers that look random: the splitmix64 generator (Steele, Lea & Flood, OOPSLA 2014).
struct Random(u64);

impl Random {
    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ z >> 31) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

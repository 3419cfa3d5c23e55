//! The fewest samples whose union holds all that any sample sees (patches, 2002, section 5, future work).

use crate::control::Control;
use crate::error::Error;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Rows whose union holds all bits of all rows but at most `spare` of them, in the order they were picked.
///
/// Greedy: each next row is the one with the most bits not yet covered, the first of equals. Rows that
/// later ones made needless are dropped at the end, the last picked first. At most `H(n) = 1 + 1/2 + … +
/// 1/n` times as many rows as needed, `n` the most bits in a row (Chvátal 1979, for `spare = 0`). Lazy
/// (Minoux 1978): a row's gain only falls, so only the row that leads by its last known gain is counted
/// again.
///
/// `words` has rows of `width` words.
///
/// # Errors
/// [`Error::Interrupted`] if `control` says so, which also counts the rows picked.
pub fn cover(words: &[u64], width: usize, spare: u64, control: &Control) -> Result<Vec<u32>, Error> {
    if width == 0 {
        return Ok(Vec::new());
    }
    let row = |r: u32| &words[r as usize * width..][..width];
    let mut all = vec![0; width];
    for row in words.chunks_exact(width) {
        all.iter_mut().zip(row).for_each(|(a, r)| *a |= r);
    }
    let needed = bits(&all).saturating_sub(spare);
    let mut covered = vec![0; width];
    let mut count = 0;
    let counts: Vec<u64> = words.par_chunks_exact(width).map(bits).collect();
    let mut candidates: BinaryHeap<(u64, Reverse<u32>)> =
        counts.into_iter().zip(0..).map(|(gain, r)| (gain, Reverse(r))).collect();
    let mut picked = Vec::new();
    while count < needed {
        let (known, Reverse(r)) = candidates.pop().expect("all rows together cover everything");
        let gain: u64 =
            row(r).iter().zip(&covered).map(|(r, c): (&u64, &u64)| u64::from((r & !c).count_ones())).sum();
        let leads = candidates.peek().is_none_or(|next| (gain, Reverse(r)) >= *next);
        if gain == known || leads {
            covered.iter_mut().zip(row(r)).for_each(|(c, r)| *c |= r);
            count += gain;
            picked.push(r);
            control.step(1)?;
        } else {
            candidates.push((gain, Reverse(r)));
        }
    }
    Ok(without_needless(words, width, needed, picked))
}

/// Drops rows, from the last, whose bits the others hold, as far as `needed` bits stay covered.
fn without_needless(words: &[u64], width: usize, needed: u64, mut picked: Vec<u32>) -> Vec<u32> {
    let row = |r: u32| &words[r as usize * width..][..width];
    let mut holders = vec![0_u32; width * 64];
    for &r in &picked {
        ones(row(r)).for_each(|bit| holders[bit] += 1);
    }
    let mut count = holders.iter().filter(|&&h| h > 0).count() as u64;
    for k in (0..picked.len()).rev() {
        let r = picked[k];
        let alone = ones(row(r)).filter(|&bit| holders[bit] == 1).count() as u64;
        if count - alone >= needed {
            count -= alone;
            ones(row(r)).for_each(|bit| holders[bit] -= 1);
            picked.remove(k);
        }
    }
    picked
}

/// The bits that are set.
fn ones(words: &[u64]) -> impl Iterator<Item = usize> {
    words.iter().enumerate().flat_map(|(w, &word)| {
        std::iter::successors((word != 0).then_some(word), |&word| {
            let rest = word & (word - 1);
            (rest != 0).then_some(rest)
        })
        .map(move |word| 64 * w + word.trailing_zeros() as usize)
    })
}

fn bits(words: &[u64]) -> u64 {
    words.iter().map(|w| u64::from(w.count_ones())).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn greedy(rows: &[u64], spare: u64) -> Vec<u32> {
        cover(rows, 1, spare, &Control::default()).unwrap()
    }

    #[test]
    fn greedy_takes_the_largest_first_and_the_first_of_equals() {
        assert_eq!(greedy(&[0b0011, 0b0111, 0b1000, 0b1000], 0), [1, 2]);
        assert_eq!(greedy(&[0b0011, 0b0111, 0b1000, 0b1000], 1), [1]);
        assert_eq!(greedy(&[0, 0], 0), [0_u32; 0]);
        assert_eq!(greedy(&[], 0), [0_u32; 0]);
    }

    #[test]
    fn a_row_that_led_once_is_counted_again() {
        // After the first, the second row adds one bit and the third two.
        assert_eq!(greedy(&[0b0001_1111, 0b0010_0111, 0b1100_0000], 0), [0, 2, 1]);
    }

    #[test]
    fn rows_that_later_ones_replace_are_dropped() {
        // The middle row is the largest, but the outer two hold all of it between them.
        assert_eq!(greedy(&[0b000_111, 0b011_110, 0b111_000], 0), [0, 2]);
    }

    #[test]
    fn stopping_is_an_error() {
        let control = Control::default();
        control.stop();
        assert_eq!(cover(&[1, 2], 1, 0, &control), Err(Error::Interrupted));
    }

    proptest! {
        #[test]
        fn what_is_picked_covers_and_nothing_is_needless(rows in prop::collection::vec(any::<[u64; 2]>(), 1..12), mask in any::<u64>(), spare in 0..20_u64) {
            let words: Vec<u64> = rows.iter().flatten().map(|w| w & mask).collect();
            let union = |picked: &mut dyn Iterator<Item = usize>| picked.fold([0, 0], |u, r| [u[0] | words[2 * r], u[1] | words[2 * r + 1]]);
            let all = bits(&union(&mut (0..rows.len())));
            let picked = cover(&words, 2, spare, &Control::default()).unwrap();
            let covered = |skip: Option<u32>| bits(&union(&mut picked.iter().filter(|&&r| Some(r) != skip).map(|&r| r as usize)));
            prop_assert!(covered(None) + spare >= all);
            for &r in &picked {
                prop_assert!(covered(Some(r)) + spare < all);
            }
        }
    }
}

//! A binary arithmetic coder with adaptive probabilities.
//!
//! The carry-less range coder of the PAQ family (M. Mahoney, 2002): two 32-bit bounds, narrowed by each bit in
//! proportion to its probability, shifted out byte by byte as their leading bytes agree.

/// Counts after which a probability adapts no slower: tuned on rows of bunny and brain.
const SLOWEST: u16 = 160;

/// An adaptive estimate of how likely a bit is set.
#[derive(Clone, Copy)]
pub struct Probability {
    /// Of 2^16.
    set: u16,
    seen: u16,
}

impl Probability {
    pub const EVEN: Self = Self { set: 1 << 15, seen: 0 };

    #[inline(always)]
    fn learn(&mut self, bit: bool) {
        let target = if bit { 65_535 } else { 0 };
        let step = ((target - i32::from(self.set)) * INVERSE[usize::from(self.seen)]) >> 16;
        // Never 0 or 65535 of 65536: either bit stays possible.
        self.set = (i32::from(self.set) + step).clamp(32, 65_535 - 32) as u16;
        self.seen += u16::from(self.seen < SLOWEST);
    }
}

/// `2^16 / (n + 1.5)` for each count `n`.
static INVERSE: [i32; SLOWEST as usize + 1] = {
    let mut table = [0; SLOWEST as usize + 1];
    let mut n = 0;
    while n < table.len() {
        table[n] = (1 << 17) / (2 * n as i32 + 3);
        n += 1;
    }
    table
};

/// One of the two ways through the same model.
pub trait Coder {
    /// Whether bits are put in, rather than taken out.
    const ENCODES: bool;

    /// Puts `bit` in and returns it, or returns the one taken out.
    fn code(&mut self, bit: bool, probability: &mut Probability) -> bool;
}

/// The bounds between which the coded number lies.
struct Bounds {
    low: u32,
    high: u32,
}

impl Bounds {
    const ALL: Self = Self { low: 0, high: u32::MAX };

    /// The last number that stands for a set bit.
    #[inline(always)]
    fn middle(&self, probability: Probability) -> u32 {
        let range = self.high - self.low;
        self.low + ((u64::from(range) * u64::from(probability.set)) >> 16) as u32
    }

    #[inline(always)]
    fn narrow(&mut self, bit: bool, middle: u32) {
        if bit {
            self.high = middle;
        } else {
            self.low = middle + 1;
        }
    }

    /// Whether the leading byte is settled.
    #[inline(always)]
    fn settled(&self) -> bool {
        (self.low ^ self.high) >> 24 == 0
    }

    #[inline(always)]
    fn shift(&mut self) {
        self.low <<= 8;
        self.high = self.high << 8 | 0xff;
    }
}

pub struct Encoder {
    bounds: Bounds,
    bytes: Vec<u8>,
}

impl Encoder {
    pub fn new() -> Self {
        Self { bounds: Bounds::ALL, bytes: Vec::new() }
    }

    /// The coded bytes.
    pub fn finish(mut self) -> Vec<u8> {
        self.bytes.extend(self.bounds.high.to_be_bytes());
        self.bytes
    }
}

impl Coder for Encoder {
    const ENCODES: bool = true;

    #[inline(always)]
    fn code(&mut self, bit: bool, probability: &mut Probability) -> bool {
        let middle = self.bounds.middle(*probability);
        self.bounds.narrow(bit, middle);
        while self.bounds.settled() {
            self.bytes.push((self.bounds.high >> 24) as u8);
            self.bounds.shift();
        }
        probability.learn(bit);
        bit
    }
}

/// Takes bits out of any bytes whatever; past their end it reads zeros.
pub struct Decoder<'a> {
    bounds: Bounds,
    number: u32,
    bytes: std::slice::Iter<'a, u8>,
}

impl<'a> Decoder<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { bounds: Bounds::ALL, number: 0, bytes: bytes.iter() };
        for _ in 0..4 {
            decoder.pull();
        }
        decoder
    }

    #[inline(always)]
    fn pull(&mut self) {
        self.number = self.number << 8 | u32::from(self.bytes.next().copied().unwrap_or(0));
    }

    /// Bytes that nothing was read from.
    pub fn left(&self) -> usize {
        self.bytes.len()
    }
}

impl Coder for Decoder<'_> {
    const ENCODES: bool = false;

    #[inline(always)]
    fn code(&mut self, _: bool, probability: &mut Probability) -> bool {
        let middle = self.bounds.middle(*probability);
        let bit = self.number <= middle;
        self.bounds.narrow(bit, middle);
        while self.bounds.settled() {
            self.bounds.shift();
            self.pull();
        }
        probability.learn(bit);
        bit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bits_come_out_as_they_went_in(bits in prop::collection::vec(prop::bool::weighted(0.03), 0..3000)) {
            let mut encoder = Encoder::new();
            let mut probability = Probability::EVEN;
            for &bit in &bits {
                encoder.code(bit, &mut probability);
            }
            let bytes = encoder.finish();
            prop_assert!(bytes.len() < bits.len() / 12 + 60);
            let mut decoder = Decoder::new(&bytes);
            let mut probability = Probability::EVEN;
            for &bit in &bits {
                prop_assert_eq!(decoder.code(false, &mut probability), bit);
            }
            prop_assert_eq!(decoder.left(), 0);
        }

        #[test]
        fn any_bytes_decode_to_something(bytes in prop::collection::vec(any::<u8>(), 0..40)) {
            let mut decoder = Decoder::new(&bytes);
            let mut probability = Probability::EVEN;
            (0..2000).for_each(|_| { decoder.code(false, &mut probability); });
        }
    }
}

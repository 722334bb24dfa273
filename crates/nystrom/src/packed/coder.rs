//! An entropy coder: range variant of asymmetric numeral systems \[Duda2013\], with 32 bits of state and bytes of renewal.
//!
//! It works like a stack: what is pushed last comes out first. So the encoder collects all steps and pushes them backwards.
//! The decoder trusts nothing: behind the last byte it reads zeros and remembers that it did.

use super::tables::{Table, Tables};

/// The state never falls below it between two steps.
const LEAST: u32 = 1 << 23;
/// Bits that one step without a table takes at most.
const MAX_RAW_BITS: u32 = 16;
/// Class that says that the class itself follows.
const ESCAPE: u32 = 15;
const CLASS_BITS: u32 = 6;

/// Where symbols and plain bits go.
pub(super) trait Sink {
    /// A symbol 0…15 of one of the tables.
    fn symbol(&mut self, table: usize, symbol: u32);

    /// The low `n_bits` (at most 16) of a number, each value as likely as any other.
    fn raw(&mut self, value: u32, n_bits: u32);

    /// The low `n_bits` (at most 32) of a number.
    #[expect(clippy::arithmetic_side_effects, reason = "only where more bits than `low` are asked for")]
    fn bits(&mut self, value: u32, n_bits: u32) {
        let low = n_bits.min(MAX_RAW_BITS);
        self.raw(value & mask(low), low);
        if n_bits > low {
            self.raw((value >> low) & mask(n_bits - low), n_bits - low);
        }
    }

    /// A number: how many bits it has by a table, then the bits.
    #[expect(
        clippy::arithmetic_side_effects,
        reason = "a number has at most 32 bits, and more than 1 where one is taken off"
    )]
    fn number(&mut self, table: usize, value: u32) {
        let class = u32::BITS - value.leading_zeros();
        self.symbol(table, class.min(ESCAPE));
        if class >= ESCAPE {
            self.bits(class, CLASS_BITS);
        }
        if class > 1 {
            self.bits(value, class - 1);
        }
    }

    /// A number of either sign.
    fn signed(&mut self, table: usize, value: i32) {
        self.number(table, ((value << 1) ^ (value >> 31)) as u32);
    }
}

/// Counts symbols, so that tables can be made.
#[derive(Clone)]
pub(super) struct Counter {
    pub(super) counts: Vec<[u32; 16]>,
}

impl Sink for Counter {
    #[expect(clippy::arithmetic_side_effects, reason = "no symbol of a matrix that lies in memory comes 2^32 times")]
    fn symbol(&mut self, table: usize, symbol: u32) {
        self.counts[table][symbol as usize] += 1;
    }

    fn raw(&mut self, _: u32, _: u32) {}
}

/// One step: a share of 2^bits.
#[derive(Clone, Copy)]
struct Step {
    start: u16,
    len: u16,
    bits: u8,
}

/// Collects steps and makes bytes of them.
pub(super) struct Encoder<'a> {
    tables: &'a Tables,
    steps: Vec<Step>,
}

impl<'a> Encoder<'a> {
    pub(super) fn new(tables: &'a Tables) -> Self {
        Self { tables, steps: Vec::new() }
    }

    #[expect(
        clippy::arithmetic_side_effects,
        reason = "shares are at least 1 and at most 2^12, and states are below 2^31"
    )]
    pub(super) fn finish(self) -> Vec<u8> {
        let (mut state, mut backwards) = (LEAST, Vec::new());
        for step in self.steps.iter().rev() {
            let most = u64::from((LEAST >> step.bits) << 8) * u64::from(step.len);
            while u64::from(state) >= most {
                backwards.push(state as u8);
                state >>= 8;
            }
            let len = u32::from(step.len);
            state = ((state / len) << step.bits) + state % len + u32::from(step.start);
        }
        backwards.extend(state.to_le_bytes());
        backwards.reverse();
        backwards
    }
}

impl Sink for Encoder<'_> {
    fn symbol(&mut self, table: usize, symbol: u32) {
        let (start, len) = self.tables.get(table).share(symbol);
        self.steps.push(Step { start, len, bits: Table::BITS as u8 });
    }

    fn raw(&mut self, value: u32, n_bits: u32) {
        if n_bits > 0 {
            self.steps.push(Step { start: value as u16, len: 1, bits: n_bits as u8 });
        }
    }
}

/// Takes back what an encoder with the same tables was given, in the same order.
pub(super) struct Decoder<'a> {
    tables: &'a Tables,
    state: u32,
    rest: &'a [u8],
    /// Whether it has read behind the last byte: nothing can come of that.
    is_lost: bool,
}

impl<'a> Decoder<'a> {
    pub(super) fn new(tables: &'a Tables, bytes: &'a [u8]) -> Self {
        let mut decoder = Self { tables, state: 0, rest: bytes, is_lost: false };
        decoder.state = (0..4).fold(0, |state, _| (state << 8) | decoder.byte());
        decoder
    }

    /// Whether all went as an encoder would have it: the state is back where it began, and no byte is left.
    pub(super) fn is_clean(&self) -> bool {
        self.state == LEAST && self.rest.is_empty() && !self.is_lost
    }

    /// Whether the bytes ended too early.
    pub(super) fn is_lost(&self) -> bool {
        self.is_lost
    }

    pub(super) fn symbol(&mut self, table: usize) -> u32 {
        let table = self.tables.get(table);
        let at = self.state & mask(Table::BITS);
        let symbol = table.symbol_at(at);
        let (start, len) = table.share(symbol);
        self.advance(Table::BITS, u32::from(start), u32::from(len));
        symbol
    }

    #[expect(clippy::arithmetic_side_effects, reason = "only where more bits than `low` are asked for")]
    pub(super) fn bits(&mut self, n_bits: u32) -> u32 {
        let low = n_bits.min(MAX_RAW_BITS);
        let value = self.raw(low);
        if n_bits > low { value | self.raw(n_bits - low) << low } else { value }
    }

    #[expect(clippy::arithmetic_side_effects, reason = "a class is at most 32, and here at least 2")]
    pub(super) fn number(&mut self, table: usize) -> u32 {
        let class = match self.symbol(table) {
            ESCAPE => self.bits(CLASS_BITS).min(u32::BITS),
            class => class,
        };
        match class {
            0 | 1 => class,
            _ => 1 << (class - 1) | self.bits(class - 1),
        }
    }

    pub(super) fn signed(&mut self, table: usize) -> i32 {
        let value = self.number(table);
        (value >> 1) as i32 ^ ((value & 1) as i32).wrapping_neg()
    }

    fn raw(&mut self, n_bits: u32) -> u32 {
        if n_bits == 0 {
            return 0;
        }
        let value = self.state & mask(n_bits);
        self.advance(n_bits, value, 1);
        value
    }

    fn advance(&mut self, bits: u32, start: u32, len: u32) {
        let at = self.state & mask(bits);
        // In bounds for bytes of an encoder; others may say what they like.
        self.state = len.wrapping_mul(self.state >> bits).wrapping_add(at).wrapping_sub(start);
        while self.state < LEAST && !self.is_lost {
            self.state = (self.state << 8) | self.byte();
        }
    }

    fn byte(&mut self) -> u32 {
        match self.rest.split_first() {
            Some((first, rest)) => {
                self.rest = rest;
                u32::from(*first)
            }
            None => {
                self.is_lost = true;
                0
            }
        }
    }
}

#[expect(clippy::arithmetic_side_effects, reason = "at most 16 bits are asked for")]
fn mask(n_bits: u32) -> u32 {
    (1 << n_bits) - 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn example(sink: &mut impl Sink, seed: u64) {
        let mut rng = Random::new([seed, 0]);
        for _ in 0..500 {
            match rng.below(4) {
                0 => sink.symbol(rng.below(3), rng.below(16) as u32),
                1 => sink.bits(rng.bits() as u32 >> 12, 20),
                2 => sink.number(rng.below(3), rng.bits() as u32 >> rng.below(32)),
                _ => sink.signed(rng.below(3), rng.bits() as i32 >> rng.below(32)),
            }
        }
    }

    fn check(decoder: &mut Decoder<'_>, seed: u64) {
        let mut rng = Random::new([seed, 0]);
        for _ in 0..500 {
            match rng.below(4) {
                0 => {
                    let table = rng.below(3);
                    assert_eq!(decoder.symbol(table), rng.below(16) as u32);
                }
                1 => {
                    let value = rng.bits() as u32 >> 12;
                    assert_eq!(decoder.bits(20), value);
                }
                2 => {
                    let table = rng.below(3);
                    assert_eq!(decoder.number(table), rng.bits() as u32 >> rng.below(32));
                }
                _ => {
                    let table = rng.below(3);
                    assert_eq!(decoder.signed(table), rng.bits() as i32 >> rng.below(32));
                }
            }
        }
    }

    #[test]
    fn symbols_and_numbers_come_back_in_their_order() {
        for seed in 0..20 {
            let mut counter = Counter { counts: vec![[0; 16]; 3] };
            example(&mut counter, seed);
            let tables = Tables::from_counts(&counter.counts);
            let mut encoder = Encoder::new(&tables);
            example(&mut encoder, seed);
            let bytes = encoder.finish();
            let mut decoder = Decoder::new(&tables, &bytes);
            check(&mut decoder, seed);
            assert!(decoder.is_clean(), "seed {seed}");
        }
    }

    #[test]
    fn a_likely_symbol_takes_little_room() {
        let mut counter = Counter { counts: vec![[0; 16]; 1] };
        (0..4000).for_each(|i| counter.symbol(0, u32::from(i % 100 == 0)));
        let tables = Tables::from_counts(&counter.counts);
        let mut encoder = Encoder::new(&tables);
        (0..4000).for_each(|i| encoder.symbol(0, u32::from(i % 100 == 0)));
        // 4000 · 0.081 bits.
        let n_bytes = encoder.finish().len();
        assert!((38..50).contains(&n_bytes), "{n_bytes}");
    }

    #[test]
    fn bytes_of_nobody_end_in_some_state_and_never_in_a_panic() {
        let tables = Tables::from_counts(&[[1; 16]]);
        let mut rng = Random::new([77, 0]);
        let mut n_clean = 0;
        for _ in 0..2000 {
            let bytes: Vec<u8> = (0..rng.below(40)).map(|_| rng.bits() as u8).collect();
            let mut decoder = Decoder::new(&tables, &bytes);
            (0..50).for_each(|_| assert!(decoder.symbol(0) < 16 && decoder.bits(5) < 32));
            n_clean += usize::from(decoder.is_clean());
        }
        assert_eq!(n_clean, 0);
    }
}

//! Rounded coefficients as symbols: how large one is likely to be is told by those around it that are known already.

use super::coder::{Decoder, Sink};

/// Kinds of coefficients that have tables of their own: of rows (the mean of the bundle, the rest) and of columns, each for
/// the first component and for the others; and of the kept product.
pub(super) const N_KINDS: usize = 8;
const N_CONTEXTS: usize = 16;
/// Tables of coefficients.
pub(super) const N_TABLES: usize = N_KINDS * N_CONTEXTS + 1;
/// Table of what is beyond all classes.
const HUGE: usize = N_KINDS * N_CONTEXTS;

/// Magnitudes that are symbols of their own; beyond, each class is twice as wide as the one before.
const N_SINGLE: u32 = 6;
/// The symbol of magnitudes beyond all classes.
const ESCAPE: u32 = 15;

/// Weights of the neighbors: those before and above; those diagonally above; those two before and two above.
const NEAR: u32 = 8;
const DIAGONAL: u32 = 4;
const FAR: u32 = 3;
/// A mean magnitude of 1 around a coefficient in these weights.
const WHOLE: u32 = 20;
/// Mean magnitudes, in twentieths, above which the next context begins.
const EDGES: [u32; N_CONTEXTS - 1] = [0, 3, 6, 10, 15, 20, 30, 40, 60, 90, 140, 240, 500, 1200, 3000];
/// Magnitudes count up to here, so that sums stay small.
const MOST: u32 = 1 << 16;

/// A plane of coefficients, low frequencies first.
#[derive(Clone, Copy)]
pub(super) struct Shape {
    pub kind: usize,
    pub width: usize,
    pub height: usize,
}

impl Shape {
    /// Context of the coefficient at a place, from what comes before it and, at the same place, in the first plane.
    #[expect(clippy::arithmetic_side_effects, reason = "places are within the plane, and magnitudes at most `MOST`")]
    fn table(self, before: &[i32], [x, y]: [usize; 2], first_plane: Option<&[i32]>) -> usize {
        let at = y * self.width + x;
        let magnitude = |back: usize| before[at - back].unsigned_abs().min(MOST);
        let mut sum = 0;
        if x > 0 {
            sum += NEAR * magnitude(1);
        }
        if x > 1 {
            sum += FAR * magnitude(2);
        }
        if y > 0 {
            sum += NEAR * magnitude(self.width);
            if x > 0 {
                sum += DIAGONAL * magnitude(self.width + 1);
            }
            if x + 1 < self.width {
                sum += DIAGONAL * magnitude(self.width - 1);
            }
        }
        if y > 1 {
            sum += FAR * magnitude(2 * self.width);
        }
        if let Some(first) = first_plane {
            sum = 3 * sum / 5 + WHOLE / 2 * first[at].unsigned_abs().min(MOST);
        }
        self.kind * N_CONTEXTS + EDGES.partition_point(|&edge| edge < sum)
    }

    /// Places x, y in the order of their coefficients.
    fn places(self) -> impl Iterator<Item = [usize; 2]> {
        (0..self.height).flat_map(move |y| (0..self.width).map(move |x| [x, y]))
    }

    #[expect(clippy::arithmetic_side_effects, reason = "a class begins at or below its magnitudes")]
    pub(super) fn write(self, values: &[i32], first_plane: Option<&[i32]>, out: &mut impl Sink) {
        for (at, &value) in self.places().zip(values) {
            let magnitude = value.unsigned_abs();
            let (symbol, first, n_bits) = class_of(magnitude);
            out.symbol(self.table(values, at, first_plane), symbol);
            if symbol == ESCAPE {
                out.number(HUGE, magnitude - first);
            } else {
                out.bits(magnitude - first, n_bits);
            }
            if magnitude > 0 {
                out.bits(u32::from(value < 0), 1);
            }
        }
    }

    /// The plane that was written after the same first one.
    #[expect(
        clippy::arithmetic_side_effects,
        reason = "`Layout::is_sound` holds of everything that is read, and magnitudes fit an `i32`"
    )]
    pub(super) fn read(self, first_plane: Option<&[i32]>, input: &mut Decoder<'_>) -> Vec<i32> {
        let mut values = Vec::with_capacity(self.width * self.height);
        for at in self.places() {
            let symbol = input.symbol(self.table(&values, at, first_plane));
            let (first, n_bits) = class(symbol);
            let rest = if symbol == ESCAPE { input.number(HUGE) } else { input.bits(n_bits) };
            let magnitude = first.saturating_add(rest).min(i32::MAX as u32) as i32;
            let is_negative = magnitude > 0 && input.bits(1) == 1;
            values.push(if is_negative { -magnitude } else { magnitude });
        }
        values
    }
}

/// First magnitude of a symbol, and how many bits tell which of its magnitudes it is.
#[expect(clippy::arithmetic_side_effects, reason = "symbols are at most 15")]
fn class(symbol: u32) -> (u32, u32) {
    if symbol < N_SINGLE {
        return (symbol, 0);
    }
    let n_bits = symbol - N_SINGLE + 1;
    (N_SINGLE - 2 + (1 << n_bits), n_bits)
}

/// Symbol of a magnitude, with its class.
#[expect(clippy::arithmetic_side_effects, reason = "magnitudes are at least `N_SINGLE` here")]
fn class_of(magnitude: u32) -> (u32, u32, u32) {
    if magnitude < N_SINGLE {
        return (magnitude, magnitude, 0);
    }
    let symbol = ((magnitude - (N_SINGLE - 2)).ilog2() + N_SINGLE - 1).min(ESCAPE);
    let (first, n_bits) = class(symbol);
    (symbol, first, n_bits)
}

#[cfg(test)]
mod tests {
    use super::super::{
        coder::{Counter, Encoder},
        tables::Tables,
    };
    use super::*;
    use crate::random::Random;

    #[test]
    fn classes_follow_each_other_without_gaps() {
        let mut next = 0;
        for symbol in 0..ESCAPE {
            let (first, n_bits) = class(symbol);
            assert_eq!(first, next);
            next = first + (1 << n_bits);
            assert_eq!((class_of(first).0, class_of(next - 1).0), (symbol, symbol));
        }
        assert_eq!((class_of(next).0, class_of(u32::MAX / 2).0), (ESCAPE, ESCAPE));
    }

    #[test]
    fn planes_come_back_at_every_magnitude() {
        let mut rng = Random::new([6, 6]);
        let shape = Shape { kind: 2, width: 9, height: 7 };
        for magnitude in [0.0, 0.3, 3.0, 300.0, 1e8] {
            let mut plane = || (0..63).map(|_| (rng.normal() * magnitude) as i32).collect::<Vec<_>>();
            let (first, second) = (plane(), plane());
            let planes = [(&first, None), (&second, Some(&first[..]))];
            let mut counter = Counter { counts: vec![[0; 16]; N_TABLES] };
            planes.iter().for_each(|(plane, before)| shape.write(plane, *before, &mut counter));
            let tables = Tables::from_counts(&counter.counts);
            let mut encoder = Encoder::new(&tables);
            planes.iter().for_each(|(plane, before)| shape.write(plane, *before, &mut encoder));
            let bytes = encoder.finish();
            let mut decoder = Decoder::new(&tables, &bytes);
            let read = shape.read(None, &mut decoder);
            assert_eq!(read, first, "{magnitude}");
            assert_eq!(shape.read(Some(&read), &mut decoder), second, "{magnitude}");
            assert!(decoder.is_clean());
        }
    }
}

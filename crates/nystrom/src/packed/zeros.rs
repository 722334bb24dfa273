//! Bundles that are zero in every column.
//!
//! Rounded cosines end at no border, so that rows of nothing beside rows of something would come back as noise. A block that has both
//! tells which bundles are zero; when all else is restored, their rows of the left factor are zero again.

use super::{
    coder::{Decoder, Sink},
    kept::Plain,
    layout::Layout,
};
use crate::factors::BlockFactors;

/// Which bundles of a block are zero in every column, sparse entries aside: some, and not all.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ZeroBundles(Vec<bool>);

impl ZeroBundles {
    /// `None` where no bundle is zero, or all are.
    #[expect(clippy::arithmetic_side_effects, reason = "the size of a block that lies in memory")]
    pub(super) fn of(factors: &BlockFactors, layout: &Layout) -> Option<Self> {
        let n_values = factors.rank as usize * layout.bundle_len as usize;
        let bundles = factors.left.chunks_exact(n_values.max(1));
        let is_zero: Vec<bool> = bundles.map(|bundle| bundle.iter().all(|x| x.to_f32() == 0.0)).collect();
        (is_zero.contains(&true) && is_zero.contains(&false)).then_some(Self(is_zero))
    }

    /// Row by row of the tile: a row that is as the one above is a bit, above the first one nothing is zero.
    pub(super) fn write(&self, width: usize, out: &mut impl Sink) {
        let none = vec![false; width];
        let mut above = &none[..];
        for row in self.0.chunks(width.max(1)) {
            out.bits(u32::from(row == above), 1);
            if row != above {
                row.iter().for_each(|&is_zero| out.bits(u32::from(is_zero), 1));
            }
            above = row;
        }
    }

    /// Those of a tile of some width and height; `None` where the bytes end too early.
    pub(super) fn read([width, height]: [u32; 2], input: &mut Decoder<'_>) -> Option<Self> {
        let (mut is_zero, mut row) = (Vec::new(), vec![false; width as usize]);
        for _ in 0..height {
            if input.bits(1) == 0 {
                row.iter_mut().for_each(|is_zero| *is_zero = input.bits(1) == 1);
            }
            if input.is_lost() {
                return None;
            }
            is_zero.extend(&row);
        }
        Some(Self(is_zero))
    }

    /// Makes them zero in the factors of their block.
    #[expect(clippy::arithmetic_side_effects, reason = "a block has bundles")]
    pub(super) fn clear(&self, plain: &mut Plain) {
        let n_values = plain.left.len() / self.0.len();
        let bundles = plain.left.chunks_exact_mut(n_values.max(1)).zip(&self.0);
        bundles.filter(|(_, is_zero)| **is_zero).for_each(|(bundle, _)| bundle.fill(0.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        packed::{ColumnRun, coder::Encoder, tables::Tables},
        partition::Partition,
        random::Random,
    };

    #[test]
    fn bundles_come_back_from_few_bits() {
        let mut rng = Random::new([71, 0]);
        let tables = Tables::from_counts(&[[1; 16]]);
        for [width, height] in [[1u32, 1], [1, 9], [16, 16], [5, 16], [17, 3]] {
            let n_bundles = (width * height) as usize;
            let beside: Vec<bool> = (0..n_bundles as u32).map(|at| at % width < width / 2).collect();
            let any: Vec<bool> = (0..n_bundles).map(|_| rng.below(3) == 0).collect();
            for zeros in [beside, any].map(ZeroBundles) {
                let mut out = Encoder::new(&tables);
                zeros.write(width as usize, &mut out);
                let bytes = out.finish();
                assert!(bytes.len() <= (n_bundles + height as usize).div_ceil(8) + 4, "{} bytes", bytes.len());
                let mut input = Decoder::new(&tables, &bytes);
                assert_eq!(ZeroBundles::read([width, height], &mut input), Some(zeros));
                assert!(input.is_clean());
            }
        }
        assert_eq!(ZeroBundles::read([4, u32::MAX], &mut Decoder::new(&tables, &[0; 5])), None);
    }

    #[test]
    fn only_blocks_that_have_both_tell_of_zeros() {
        let layout = Layout::new(Partition { width: 2, height: 1, tile: 2 }, 2, vec![ColumnRun::List(1)]);
        let of = |left: [f32; 4]| ZeroBundles::of(&BlockFactors::from_f32(&left, &[1.0], 4, 1, 1), &layout);
        assert_eq!(of([1.0, 0.0, 0.0, -2.0]), None, "a member that is zero makes no bundle");
        assert_eq!(of([0.0; 4]), None);
        assert_eq!(of([0.0, -0.0, 0.0, 3.0]), Some(ZeroBundles(vec![true, false])));
        assert_eq!(ZeroBundles::of(&BlockFactors::from_f32(&[], &[], 4, 1, 0), &layout), None);
    }
}

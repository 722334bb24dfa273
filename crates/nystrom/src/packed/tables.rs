//! How likely each symbol is, table by table: fixed for a whole matrix, so that blocks can be read in any order.

use super::coder::{Decoder, Encoder, Sink};

/// Symbols of a table.
const N_SYMBOLS: usize = 16;

/// Shares of the symbols 0…15; none is 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Table {
    /// Where each share begins; the last entry is 2^[`Table::BITS`].
    starts: [u16; N_SYMBOLS + 1],
}

impl Table {
    /// Shares add up to two to this power.
    pub(super) const BITS: u32 = 12;

    #[expect(clippy::arithmetic_side_effects, reason = "sixteen shares add up to 2^12")]
    fn from_shares(shares: [u16; N_SYMBOLS]) -> Self {
        let mut starts = [0; N_SYMBOLS + 1];
        for (i, share) in shares.into_iter().enumerate() {
            starts[i + 1] = starts[i] + share;
        }
        Self { starts }
    }

    /// Shares in proportion to counts, with a little for what never came.
    #[expect(clippy::arithmetic_side_effects, reason = "sixteen shares add up to 2^12")]
    fn from_counts(counts: &[u32; N_SYMBOLS]) -> Self {
        let whole = 1u64 << Self::BITS;
        let total: u64 = counts.iter().map(|&count| u64::from(count)).sum();
        let mut shares = counts.map(|count| (u64::from(count) * whole / total.max(1)).max(1) as u16);
        // What rounding took or gave, the largest share bears.
        let sum: i32 = shares.iter().map(|&share| i32::from(share)).sum();
        let largest = (0..N_SYMBOLS).max_by_key(|&i| (shares[i], N_SYMBOLS - i)).expect("there are symbols");
        shares[largest] = (i32::from(shares[largest]) + whole as i32 - sum) as u16;
        Self::from_shares(shares)
    }

    /// Start and length of a symbol's share.
    #[expect(clippy::arithmetic_side_effects, reason = "sixteen shares add up to 2^12")]
    pub(super) fn share(&self, symbol: u32) -> (u16, u16) {
        let i = symbol as usize;
        (self.starts[i], self.starts[i + 1] - self.starts[i])
    }

    /// The symbol whose share holds a place below 2^[`Table::BITS`].
    #[expect(clippy::arithmetic_side_effects, reason = "sixteen shares add up to 2^12")]
    pub(super) fn symbol_at(&self, place: u32) -> u32 {
        let mut symbol = 0;
        while symbol + 1 < N_SYMBOLS && u32::from(self.starts[symbol + 1]) <= place {
            symbol += 1;
        }
        symbol as u32
    }
}

/// All tables of a matrix.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Tables(Vec<Table>);

impl Tables {
    pub(super) fn from_counts(counts: &[[u32; N_SYMBOLS]]) -> Self {
        Self(counts.iter().map(Table::from_counts).collect())
    }

    pub(super) fn get(&self, table: usize) -> &Table {
        &self.0[table]
    }

    /// The tables as bytes: of each the shares up to the last one that is more than the least.
    #[expect(clippy::arithmetic_side_effects, reason = "sixteen shares add up to 2^12")]
    pub(super) fn encode(&self) -> Vec<u8> {
        let plain = Self::plain();
        let mut out = Encoder::new(&plain);
        for table in &self.0 {
            let shares: Vec<u16> = (0..N_SYMBOLS as u32).map(|symbol| table.share(symbol).1).collect();
            let used = shares.iter().rposition(|&share| share > 1).expect("shares add up to more than one each");
            out.bits(used as u32, 4);
            // The last one takes what is left.
            shares[..used].iter().for_each(|&share| out.number(0, u32::from(share - 1)));
        }
        out.finish()
    }

    /// Reads `count` tables; `None` if no encoder wrote these bytes.
    pub(super) fn decode(bytes: &[u8], count: usize) -> Option<Self> {
        let plain = Self::plain();
        let mut input = Decoder::new(&plain, bytes);
        let tables = (0..count).map(|_| read_table(&mut input)).collect::<Option<Vec<_>>>()?;
        input.is_clean().then_some(Self(tables))
    }

    /// What the tables themselves are written with: numbers of up to twelve bits, all lengths alike.
    fn plain() -> Self {
        Self::from_counts(&[[1; N_SYMBOLS]])
    }
}

#[expect(clippy::arithmetic_side_effects, reason = "sixteen shares add up to 2^12")]
fn read_table(input: &mut Decoder<'_>) -> Option<Table> {
    let used = input.bits(4) as usize;
    let mut shares = [1u16; N_SYMBOLS];
    let mut left = (1u32 << Table::BITS) - (N_SYMBOLS - 1 - used) as u32;
    for share in &mut shares[..used] {
        *share = u16::try_from(input.number(0)).ok()?.checked_add(1)?;
        left = left.checked_sub(u32::from(*share))?;
    }
    shares[used] = u16::try_from(left).ok().filter(|&left| left > 0)?;
    Some(Table::from_shares(shares))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn tables_come_back_from_their_bytes() {
        let mut rng = Random::new([5, 0]);
        let mut counts = vec![[0; 16], [1; 16]];
        counts.extend((0..30).map(|_| {
            let n_used = 1 + rng.below(16);
            std::array::from_fn(|i| if i < n_used { rng.bits() as u32 >> (8 + rng.below(24)) } else { 0 })
        }));
        let tables = Tables::from_counts(&counts);
        for table in &tables.0 {
            assert_eq!(table.starts[16], 1 << Table::BITS);
            for symbol in 0..16 {
                let (start, len) = table.share(symbol);
                assert!(len > 0);
                assert_eq!(
                    (table.symbol_at(start.into()), table.symbol_at((start + len - 1).into())),
                    (symbol, symbol)
                );
            }
        }
        let bytes = tables.encode();
        assert_eq!(Tables::decode(&bytes, counts.len()), Some(tables.clone()));
        assert_eq!(Tables::decode(&bytes, counts.len() - 1), None);
        assert_eq!(Tables::decode(&bytes[..bytes.len() / 2], counts.len()), None);
    }
}

//! Hostile files from valid ones, reproducible from a seed.

/// SplitMix64. \[Steele2014\]
pub struct Dice(pub u64);

impl Dice {
    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    /// A number below `n`; 0 for 0.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % (n as u64).max(1)) as usize
    }

    fn pick<'a, T: ?Sized>(&mut self, choices: &[&'a T]) -> &'a T {
        choices[self.below(choices.len())]
    }
}

/// Numbers that break what was not expected.
const NUMBERS: [&str; 18] = [
    "0",
    "1",
    "-1",
    "2",
    "0.5",
    "-0.0",
    "1e-45",
    "1e39",
    "-1e39",
    "1e300",
    "1e400",
    "255",
    "65536",
    "16777217",
    "4294967295",
    "4294967296",
    "18446744073709551615",
    "null",
];
const WORDS: [u32; 12] =
    [0, 1, 2, 0x7F, 0xFF, 0xFFFF, 0x1_0000, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF, 0x7F80_0000, 0x7FC0_0000];

/// A hostile version of a file.
pub fn mutated(seed: &[u8], other: &[u8], dice: &mut Dice) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..=dice.below(4) {
        change(&mut bytes, other, dice);
    }
    match dice.below(4) {
        0 => {}
        _ => mend(&mut bytes),
    }
    bytes
}

fn change(bytes: &mut Vec<u8>, other: &[u8], dice: &mut Dice) {
    let at = dice.below(bytes.len());
    let end = (at + 1 + dice.below(16)).min(bytes.len());
    match dice.below(12) {
        _ if bytes.is_empty() => bytes.push(dice.bits() as u8),
        0 => bytes[at] ^= 1 << dice.below(8),
        1 => bytes[at] = dice.bits() as u8,
        2 => bytes[at] = [0, 1, 0x7F, 0x80, 0xFE, 0xFF][dice.below(6)],
        3 => set_word(bytes, at, WORDS[dice.below(WORDS.len())]),
        4 => drop(bytes.drain(at..end)),
        5 => {
            let copy = bytes[at..end].to_vec();
            bytes.splice(at..at, copy.repeat(1 + dice.below(3)));
        }
        6 => bytes.truncate(at),
        7 => {
            let from = dice.below(other.len());
            bytes.splice(at..end, other[from..(from + dice.below(64)).min(other.len())].iter().copied());
        }
        _ => change_number(bytes, at, dice),
    }
}

fn set_word(bytes: &mut [u8], at: usize, word: u32) {
    for (byte, value) in bytes[at..].iter_mut().zip(word.to_le_bytes()) {
        *byte = value;
    }
}

/// Replaces the next number that is written in digits.
fn change_number(bytes: &mut Vec<u8>, at: usize, dice: &mut Dice) {
    let is_part = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b'-' | b'+' | b'.' | b'e' | b'E');
    let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit).map(|offset| at + offset) else { return };
    let end = start + bytes[start..].iter().take_while(|byte| is_part(byte)).count();
    let number = dice.pick(&NUMBERS);
    bytes.splice(start..end, number.bytes());
}

/// Makes lengths and checksums fit again, so that what lies behind them is reached.
fn mend(bytes: &mut [u8]) {
    if bytes.starts_with(b"glTF") && bytes.len() >= 20 {
        let length = bytes.len() as u32;
        set_word(bytes, 8, length);
        let json = find(bytes, b"BIN\0", 20).map_or(bytes.len().saturating_sub(20), |at| at.saturating_sub(24));
        set_word(bytes, 12, json as u32);
        if let Some(at) = find(bytes, b"BIN\0", 20).filter(|at| *at >= 24) {
            let n_bytes = bytes.len() - at - 4;
            set_word(bytes, at - 4, n_bytes as u32);
        }
    }
    if bytes.starts_with(b"CLERTRAN") && bytes.len() >= 16 {
        mend_archive(bytes);
    }
}

fn mend_archive(bytes: &mut [u8]) {
    // The JSON ends at the last closing brace before whatever follows.
    let blocks = find(bytes, b"CNBF", 16).unwrap_or(bytes.len());
    let announced = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
    if let Some(end) = bytes[16..blocks].iter().rposition(|byte| *byte == b'}').map(|at| at + 1)
        && end.abs_diff(announced) < 64
    {
        set_word(bytes, 12, end as u32);
    }
    mend_header(bytes);
    if PACKED_VERSIONS.contains(&bytes[8]) {
        return mend_packed(bytes);
    }
    let mut at = blocks;
    while let Some(start) = find(bytes, b"CNBF", at) {
        at = start + 4;
        let word = |nth: usize| -> Option<u64> {
            let four = bytes.get(start + 8 + 4 * nth..start + 12 + 4 * nth)?;
            Some(u64::from(u32::from_le_bytes(four.try_into().ok()?)))
        };
        let (Some(rows), Some(cols), Some(rank), Some(sparse)) = (word(0), word(1), word(2), word(3)) else { break };
        let sides = rows.saturating_add(cols);
        let len = rank
            .saturating_mul(sides.saturating_mul(2).saturating_add(4))
            .saturating_add(12 * sparse)
            .saturating_add(40);
        let end = len.saturating_add(start as u64);
        if end.saturating_add(8) <= bytes.len() as u64 {
            let end = end as usize;
            let sum = checksum(&bytes[start..end]);
            bytes[end..end + 8].copy_from_slice(&sum.to_le_bytes());
        }
    }
}

/// The checksum that the JSON of a header ends in: sixteen digits over all that stands before them.
fn mend_header(bytes: &mut [u8]) {
    const KEY: &[u8] = b",\"checksum\":\"";
    let end = 16 + u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
    let Some(digits) = end.checked_sub(18).filter(|at| *at > 16 + KEY.len() && end <= bytes.len()) else { return };
    if bytes[..digits].ends_with(KEY) {
        let sum = format!("{:016x}", checksum(&bytes[..digits]));
        bytes[digits..digits + 16].copy_from_slice(sum.as_bytes());
    }
}

/// Versions of files whose packed matrices follow the header, with nothing or patches between.
const PACKED_VERSIONS: [u8; 5] = [4, 5, 6, 8, 9];

/// Patches behind a header of so many bytes: a checksum over what its numbers say. Where the packed matrices begin.
fn mend_patches(bytes: &mut [u8], header_end: usize) -> usize {
    let number = |name: &str| -> Option<usize> {
        let header = bytes.get(..header_end)?;
        let at = find(header, name.as_bytes(), 16)? + name.len();
        let digits: String = header[at..].iter().take_while(|b| b.is_ascii_digit()).map(|b| char::from(*b)).collect();
        digits.parse().ok().filter(|n| *n < 1 << 20)
    };
    let numbers = ["\"n_patches\":", "\"n_samples\":", "\"n_columns\":"].map(number);
    let [Some(n_patches), Some(n_samples), Some(n_columns)] = numbers else { return header_end };
    let knows_grazing = find(&bytes[..header_end], b"\"knows_grazing\":true", 16).is_some();
    let sample_len = if knows_grazing { 32 } else { 28 };
    let extent_len = if find(&bytes[..header_end], b"\"reach_m\":", 16).is_some() { 28 } else { 0 };
    let places_len = sample_len * n_samples + extent_len * n_patches;
    let end = header_end + n_patches + places_len + 4 * n_columns + 2 * n_patches * n_columns;
    if end + 8 > bytes.len() {
        return header_end;
    }
    let sum = checksum(&bytes[header_end..end]);
    bytes[end..end + 8].copy_from_slice(&sum.to_le_bytes());
    end + 8
}

/// Packed matrices: step, a direction and tables with their lengths and a checksum over all of it, then blocks with theirs.
fn mend_packed(bytes: &mut [u8]) {
    let word = |bytes: &[u8], at: usize| -> Option<usize> {
        Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?) as usize)
    };
    let header_end = 16 + word(bytes, 12).unwrap_or(0);
    let mut at = mend_patches(bytes, header_end);
    loop {
        let start = at;
        let Some(n_direction) = word(bytes, at + 4) else { return };
        let tables = at.saturating_add(8).saturating_add(n_direction.saturating_mul(4));
        let Some(n_tables) = word(bytes, tables.min(bytes.len())) else { return };
        let end = tables + 4 + n_tables;
        if end + 8 > bytes.len() {
            return;
        }
        let sum = checksum(&bytes[start..end]);
        bytes[end..end + 8].copy_from_slice(&sum.to_le_bytes());
        at = end + 8;
        // What is no length that fits is the step of the next matrix.
        while let Some(end) = word(bytes, at).map(|len| at + 4 + len).filter(|end| end + 4 <= bytes.len()) {
            let sum =
                bytes[at..end].iter().fold(0x811c_9dc5_u32, |sum, b| (sum ^ u32::from(*b)).wrapping_mul(0x0100_0193));
            bytes[end..end + 4].copy_from_slice(&sum.to_le_bytes());
            at = end + 4;
        }
    }
}

/// FNV-1a of 64 bits.
pub fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}

fn find(bytes: &[u8], what: &[u8], from: usize) -> Option<usize> {
    bytes.get(from..)?.windows(what.len()).position(|window| window == what).map(|at| from + at)
}

//! Mode 0: elements as differences from the one before, byte by byte, in blocks.

use super::{Stream, unzigzag};

/// Most elements of a block.
const MAX_BLOCK: usize = 256;
/// Most bytes of a block.
const MAX_BLOCK_BYTES: usize = 8192;
/// Elements of a group.
const GROUP: usize = 16;

/// Bits of a difference by the two bits in the header of its group: of version 0, and of version 1 by control mode.
const BITS_0: [u32; 4] = [0, 2, 4, 8];
const BITS_1: [[u32; 4]; 2] = [[0, 1, 2, 4], [1, 2, 4, 8]];

/// `count` elements of `stride` bytes, a multiple of 4.
#[expect(
    clippy::arithmetic_side_effects,
    reason = "strides are from 4 to 256, a block has at most `MAX_BLOCK_BYTES`, and the tail is not longer than the stream"
)]
pub(super) fn decode(stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, String> {
    let (&header, body) = stream.split_first().ok_or("its stream is empty")?;
    let is_first_version = match header {
        0xA0 => true,
        0xA1 => false,
        _ => return Err(format!("its stream begins with {header:#x}, which is no stream of attributes")),
    };
    let n_channels = if is_first_version { 0 } else { stride / 4 };
    let n_tail = (stride + n_channels).max(if is_first_version { 32 } else { 24 });
    let n_body = body.len().checked_sub(n_tail).ok_or("its stream ends too early")?;
    let tail = &body[body.len() - stride - n_channels..];
    let (baseline, channels) = tail.split_at(stride);

    let mut last = baseline.to_vec();
    let mut body = Stream { rest: &body[..n_body] };
    let mut out = Vec::new();
    let block_elements = (MAX_BLOCK_BYTES / stride / GROUP * GROUP).min(MAX_BLOCK);
    let mut left = count;
    while left > 0 {
        let n = left.min(block_elements);
        let start = out.len();
        out.resize(start + n * stride, 0);
        let controls = if is_first_version { None } else { Some(body.take(stride / 4)?) };
        read_differences(&mut body, controls, &mut out[start..], stride)?;
        for channel in 0..stride / 4 {
            let mode = channels.get(channel).copied().unwrap_or(0);
            add_up(&mut out[start..], stride, channel * 4, mode, &mut last)?;
        }
        left -= n;
    }
    body.end()?;
    Ok(out)
}

/// Puts the stored differences where the elements will be.
#[expect(
    clippy::arithmetic_side_effects,
    reason = "indices in a block of at most `MAX_BLOCK_BYTES`, with a stride of at least 4"
)]
fn read_differences(body: &mut Stream, controls: Option<&[u8]>, block: &mut [u8], stride: usize) -> Result<(), String> {
    for position in 0..stride {
        let control = controls.map(|controls| controls[position / 4] >> (2 * (position % 4)) & 3);
        let bits = match control {
            None => BITS_0,
            Some(2) => continue,
            Some(3) => {
                let literal = body.take(block.len() / stride)?;
                block[position..].iter_mut().step_by(stride).zip(literal).for_each(|(to, &from)| *to = from);
                continue;
            }
            Some(mode) => BITS_1[usize::from(mode)],
        };
        let n_groups = (block.len() / stride).div_ceil(GROUP);
        let headers = body.take(n_groups.div_ceil(4))?;
        for (group, elements) in block.chunks_mut(GROUP * stride).enumerate() {
            let header = headers[group / 4] >> (2 * (group % 4)) & 3;
            let differences = read_group(body, bits[usize::from(header)])?;
            elements[position..].iter_mut().step_by(stride).zip(differences).for_each(|(to, from)| *to = from);
        }
    }
    Ok(())
}

/// Sixteen differences of so many bits; those that need more follow as bytes.
#[expect(clippy::arithmetic_side_effects, reason = "1, 2 or 4 bits of one of sixteen values")]
pub(super) fn read_group(body: &mut Stream, bits: u32) -> Result<[u8; GROUP], String> {
    let mut group = [0; GROUP];
    match bits {
        0 => {}
        8 => group.copy_from_slice(body.take(GROUP)?),
        _ => {
            let packed = body.take(GROUP * bits as usize / 8)?;
            let sentinel = (1_u8 << bits) - 1;
            let per_byte = 8 / bits;
            for (nth, value) in (0..).zip(&mut group) {
                let within = nth % per_byte;
                let shift = if bits == 1 { within } else { 8 - bits * (within + 1) };
                *value = packed[(nth / per_byte) as usize] >> shift & sentinel;
                if *value == sentinel {
                    *value = body.byte()?;
                }
            }
        }
    }
    Ok(group)
}

/// Adds differences up from element to element, over the four bytes from `position` on.
#[expect(clippy::arithmetic_side_effects, reason = "positions within an element of at most 256 bytes")]
#[expect(clippy::cast_possible_truncation, reason = "the lower bits of a code are what is meant")]
fn add_up(block: &mut [u8], stride: usize, position: usize, mode: u8, last: &mut [u8]) -> Result<(), String> {
    let (kind, rotation) = (mode & 15, u32::from(mode >> 4));
    if kind > 2 || (kind < 2 && rotation != 0) {
        return Err(format!("its stream has a channel of unknown mode {mode:#x}"));
    }
    let mut before = four(&last[position..]);
    for element in block.chunks_mut(stride) {
        let now = four(&element[position..]);
        let sum = match kind {
            0 => now.to_le_bytes().map(|code| unzigzag(u32::from(code)) as u8),
            1 => {
                let halves = [now & 0xFFFF, now >> 16].map(|code| unzigzag(code) as u16);
                ((u32::from(halves[1]) << 16) | u32::from(halves[0])).to_le_bytes()
            }
            _ => now.rotate_right(rotation).to_le_bytes(),
        };
        before = joined(kind, before, u32::from_le_bytes(sum));
        element[position..position + 4].copy_from_slice(&before.to_le_bytes());
    }
    last[position..position + 4].copy_from_slice(&before.to_le_bytes());
    Ok(())
}

/// The element after `before`, four bytes of it, which wrap one by one, two by two, or are flipped.
fn joined(kind: u8, before: u32, difference: u32) -> u32 {
    let (a, b) = (before.to_le_bytes(), difference.to_le_bytes());
    match kind {
        0 => u32::from_le_bytes(std::array::from_fn(|i| a[i].wrapping_add(b[i]))),
        1 => {
            let high = (before >> 16).wrapping_add(difference >> 16) << 16;
            high | (before.wrapping_add(difference) & 0xFFFF)
        }
        _ => before ^ difference,
    }
}

fn four(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

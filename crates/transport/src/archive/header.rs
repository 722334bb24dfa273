//! What stands before the blocks: magic, version, the header as JSON, and the map of the sky. See `docs/format.md`.
//!
//! The JSON ends in a member `checksum` over all bytes before its digits. Programs that do not know the member pass over
//! it, and files without it are read as ever: their blocks are checked, their header only for sense.

use std::path::Path;
use std::sync::Arc;

use clerestory_nystrom::codec::checksum;

use super::{ArchiveError, VERSION, damaged};
use crate::bake::BakeHeader;
use crate::basis::{ColumnKind, LightBasis, SourceKind};
use crate::patches::{self, Patches};
use crate::sky::{DOME_DIVISIONS, Environment, dome_columns};

/// Version of a file without irradiance, which older programs read.
const PLAIN_VERSION: u32 = 2;
/// Version of a file with irradiance whose blocks are not packed.
const IRRADIANCE_VERSION: u32 = 3;
/// Version of a file whose blocks are packed, without patches.
const PACKED_VERSION: u32 = 4;
/// Version of a file with patches that are lit alike from all sides.
const EVEN_PATCHES_VERSION: u32 = 5;
/// Packed, with patches that tell light by its angle.
const GRAZING_VERSION: u32 = 6;
/// Packed, with a sky that has a column of its map as it was baked; its patches do not know their areas.
const MAP_VERSION: u32 = 7;
/// Packed, with patches that know their areas; no block tells which pixels are zero.
const AREAS_VERSION: u32 = 8;
/// Oldest version that is read: it knows no sky.
const OLDEST_VERSION: u32 = 1;
/// Longest header that is believed.
const MAX_HEADER_BYTES: u32 = 256 << 20;
/// Magic, version, length of the JSON.
const FIXED_BYTES: usize = 16;
/// Before the digits of the checksum, and behind them.
const CHECKSUM_KEY: &[u8] = b",\"checksum\":\"";
const CHECKSUM_END: &[u8] = b"\"}";
const CHECKSUM_DIGITS: usize = 16;

/// How the blocks behind a header are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Blocks {
    /// In halves, each for itself: files before version 4, and bakes under way.
    Plain,
    /// Packed, group by group.
    Packed,
    /// The same with groups that tell of pixels that are zero. It is read as `Packed` is: each group says it itself.
    PackedWithZeros,
}

/// Everything before the first block.
#[expect(
    clippy::cast_possible_truncation,
    reason = "headers up to `MAX_HEADER_BYTES`; columns of a basis are counted in 32 bits"
)]
pub(super) fn header_bytes(magic: &[u8; 8], header: &BakeHeader, blocks: Blocks) -> Vec<u8> {
    let mut json = serde_json::to_vec(header).expect("a header has only string keys and plain values");
    json.pop();
    json.extend(CHECKSUM_KEY);
    #[expect(clippy::arithmetic_side_effects, reason = "bytes that lie in memory")]
    let len = json.len() + CHECKSUM_DIGITS + CHECKSUM_END.len();
    let mut bytes = magic.to_vec();
    let version = match blocks {
        Blocks::PackedWithZeros => VERSION,
        Blocks::Packed if header.patches.as_ref().is_some_and(Patches::knows_areas) => AREAS_VERSION,
        Blocks::Packed if has_map_column(&header.basis) => MAP_VERSION,
        Blocks::Packed => match &header.patches {
            None => PACKED_VERSION,
            Some(patches) if patches.knows_grazing() => GRAZING_VERSION,
            Some(_) => EVEN_PATCHES_VERSION,
        },
        Blocks::Plain if header.irradiance.is_empty() => PLAIN_VERSION,
        Blocks::Plain => IRRADIANCE_VERSION,
    };
    bytes.extend(version.to_le_bytes());
    bytes.extend((len as u32).to_le_bytes());
    bytes.extend(json);
    let digits = format!("{:016x}", checksum(&bytes));
    bytes.extend(digits.as_bytes());
    bytes.extend(CHECKSUM_END);
    if let Some(sky) = &header.basis.sky {
        bytes.extend(sky.map.encode());
    }
    if let Some(patches) = &header.patches {
        bytes.extend(patches::encode(patches));
    }
    bytes
}

/// Reads the header at the start of `bytes`, and says where the blocks begin and how they are written.
pub(super) fn parse_header(
    magic: &[u8; 8],
    bytes: &[u8],
    path: &Path,
) -> Result<(BakeHeader, usize, Blocks), ArchiveError> {
    let cut_off = || damaged(path, "it ends in its header".into());
    let word = |at: usize| bytes.get(at..)?.first_chunk().map(|word| u32::from_le_bytes(*word));
    if bytes.get(..8) != Some(magic) {
        return Err(ArchiveError::NotATransport { path: path.into() });
    }
    let version = word(8).ok_or_else(cut_off)?;
    if !(OLDEST_VERSION..=VERSION).contains(&version) {
        return Err(ArchiveError::Version { path: path.into(), version });
    }
    let len = word(12).filter(|&len| len <= MAX_HEADER_BYTES).ok_or_else(cut_off)?;
    let mut offset = FIXED_BYTES.checked_add(len as usize).ok_or_else(cut_off)?;
    let front = bytes.get(..offset).ok_or_else(cut_off)?;
    if !is_intact(front, version) {
        return Err(damaged(path, "its header: the checksum does not fit".into()));
    }
    let json = serde_json::from_slice(&front[FIXED_BYTES..]);
    let mut header: BakeHeader = json.map_err(|e| damaged(path, format!("its header: {e}")))?;
    check(&header).map_err(|what| damaged(path, what.into()))?;
    if let Some(sky) = &mut header.basis.sky {
        let map = Environment::decode(&bytes[offset..]);
        let (map, len) = map.ok_or_else(|| damaged(path, "the map of its sky".into()))?;
        sky.map = Arc::new(map);
        offset = offset.checked_add(len).ok_or_else(cut_off)?;
    }
    if let Some(patches) = &mut header.patches {
        let (found, len) =
            patches::decode(patches, &bytes[offset..]).ok_or_else(|| damaged(path, "its patches".into()))?;
        *patches = found;
        offset = offset.checked_add(len).ok_or_else(cut_off)?;
    }
    Ok((header, offset, if version >= PACKED_VERSION { Blocks::Packed } else { Blocks::Plain }))
}

/// Whether its sky, if it has one, has a column of the map as it was baked.
fn has_map_column(basis: &LightBasis) -> bool {
    basis.sources.iter().any(|source| match source.kind {
        SourceKind::Dome { divisions } => u32::try_from(source.columns.len()) == Ok(dome_columns(divisions)),
        _ => false,
    })
}

/// Whether the checksum at the end of the JSON fits. Programs that wrote none knew no packed files.
fn is_intact(front: &[u8], version: u32) -> bool {
    let content = front.strip_suffix(CHECKSUM_END).and_then(|rest| rest.split_last_chunk::<CHECKSUM_DIGITS>());
    match content.filter(|(content, _)| content.ends_with(CHECKSUM_KEY)) {
        Some((content, digits)) => *digits == *format!("{:016x}", checksum(content)).as_bytes(),
        None => version < PACKED_VERSION,
    }
}

/// A header that the rest of the program can trust.
fn check(header: &BakeHeader) -> Result<(), &'static str> {
    let max = crate::camera::Film::MAX_SIDE;
    let basis = &header.basis;
    if header.width == 0 || header.height == 0 || header.width > max || header.height > max || header.tile == 0 {
        return Err("its header has an impossible size");
    }
    check_columns(basis)?;
    if header.column_scale.len() != basis.n_cols() {
        return Err("its header has columns without a group or a scale");
    }
    if header.column_scale.iter().any(|s| !s.is_finite() || *s <= 0.0) {
        return Err("its header has an impossible scale");
    }
    if !header.is_of_columns(&header.column_error) {
        return Err("its header has impossible errors of columns");
    }
    if header.sky_reach.iter().any(|reach| !reach.is_finite() || *reach < 0.0) {
        return Err("its header has an impossible reach of the sky");
    }
    if header.view.as_ref().is_some_and(|view| !view.is_finite()) {
        return Err("its header has an impossible camera");
    }
    if basis.sky.as_ref().is_some_and(|sky| !sky.is_finite()) {
        return Err("its header has an impossible sky");
    }
    let patch_columns = basis.patch_columns().map(|columns| columns.len());
    if patch_columns != header.patches.as_ref().map(Patches::n_columns) {
        return Err("its header has patches without columns");
    }
    header.check_irradiance()
}

/// Columns that follow each other, each of one light and one group.
#[expect(
    clippy::cast_possible_truncation,
    reason = "headers up to `MAX_HEADER_BYTES`; columns of a basis are counted in 32 bits"
)]
fn check_columns(basis: &LightBasis) -> Result<(), &'static str> {
    let mut next = 0;
    for source in &basis.sources {
        if source.columns.start != next || source.columns.end < next {
            return Err("its header has columns out of order");
        }
        next = source.columns.end;
        if !source.color.is_finite() || !source.strength.is_finite() {
            return Err("its header has a light that is not finite");
        }
        let texels = match source.kind {
            SourceKind::Panel { resolution, .. } => resolution.saturating_mul(resolution),
            SourceKind::Dome { divisions } if !DOME_DIVISIONS.contains(&divisions) => {
                return Err("its header has a sky of unknown patches");
            }
            SourceKind::Dome { divisions } => {
                let all = dome_columns(divisions);
                // Before version 7 there was no column of the map as it was baked.
                if source.columns.len() as u32 == all.saturating_sub(1) { all.saturating_sub(1) } else { all }
            }
            _ => 1,
        };
        if source.columns.len() as u32 != texels {
            return Err("its header has a light with missing columns");
        }
    }
    let of_lights = basis.sources.last().map_or(0, |source| source.columns.end);
    let mut next = 0;
    for group in &basis.groups {
        // An empty group would cost memory for each block and no byte of the file.
        if group.columns.start != next || group.columns.end <= next {
            return Err("its header has groups out of order");
        }
        // Columns are counted by light as well as by group, so a group has whole lights; patches are one group behind all of them.
        let begins_light = basis.sources.binary_search_by_key(&next, |source| source.columns.start).is_ok();
        let fits = match group.kind {
            ColumnKind::Patch => next == of_lights,
            _ => begins_light && group.columns.end <= of_lights,
        };
        if !fits {
            return Err("its header has columns without a light");
        }
        next = group.columns.end;
    }
    if next as usize == basis.n_cols() { Ok(()) } else { Err("its header has columns without a group or a scale") }
}

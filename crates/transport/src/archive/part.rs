//! A bake under way: the header, then blocks as they were finished. See `docs/format.md`.
//!
//! A record is the number of its block through all matrices, one block per group of columns, and a checksum over both. Each
//! is handed to the system in one piece before anybody is told of the block, so that a killed program loses the blocks
//! that it was working on and no other.

use std::collections::HashSet;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clerestory_nystrom::codec::{checksum, encode_block};
use clerestory_nystrom::{BlockFactors, Partition};

use super::header::{Blocks, header_bytes, parse_header};
use super::{ArchiveError, Restart, at, damaged, read_block};
use crate::bake::BakeHeader;
use crate::irradiance::locate;

pub(super) const MAGIC: &[u8; 8] = b"CLERPAR2";
/// Of programs whose records had no checksum of their own.
const OLD_MAGIC: &[u8; 8] = b"CLERPART";
const CHECKSUM_LEN: usize = 8;

/// Blocks of a half-done bake by their number through all matrices.
pub(super) type Done = Vec<(usize, Vec<Arc<BlockFactors>>)>;

/// How far a half-done bake is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartState {
    /// Blocks that are there, of all matrices.
    pub n_done: usize,
    /// Blocks of all matrices.
    pub n_blocks: usize,
    /// Bytes behind the last whole block, of one that was half written.
    pub n_torn_bytes: usize,
}

/// Looks at a half-done bake without taking it up.
///
/// # Errors
/// A file that cannot be read or is no half-done bake of this program.
pub fn part_state(path: &Path) -> Result<PartState, ArchiveError> {
    let bytes = fs::read(path).map_err(at("cannot read", path))?;
    let found = understood(&bytes, path)?.ok_or_else(|| damaged(path, "it ends in its header".into()))?;
    let (header, offset, seal) = found;
    let n_blocks = header.partitions().iter().map(Partition::n_blocks).sum();
    let (done, end) = read_records(&bytes, offset, seal, &header);
    Ok(PartState { n_done: done.len(), n_blocks, n_torn_bytes: bytes[end..].len() })
}

/// What differs where the bakes are of the same thing.
pub(super) const TAKEN_OVER: &str = "it takes other columns over from an earlier bake";

/// The number of a block in front of its record.
const INDEX_LEN: usize = 4;

/// How records end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Seal {
    /// With their last block.
    Nothing,
    /// With FNV-1a over the number and the blocks.
    Checksum,
}

/// A half-done bake that this process writes to, and no other.
pub(super) struct Part {
    pub path: PathBuf,
    pub file: File,
    pub seal: Seal,
    pub header: Arc<BakeHeader>,
}

impl Part {
    /// Opens or creates the file; takes up its blocks if it belongs to the same bake, and starts over where it has none. The lock is the
    /// operating system's: it ends with the process that holds it.
    pub fn open(path: &Path, header: BakeHeader, restart: Restart) -> Result<(Part, Done), ArchiveError> {
        let mut file = locked(path)?;
        let mut bytes = Vec::new();
        if restart == Restart::Resume {
            file.read_to_end(&mut bytes).map_err(at("cannot read", path))?;
        }
        let (part, done, end) = match begun(&bytes, path, &header)? {
            Some((found, seal, done, end)) => {
                (Part { path: path.into(), file, seal, header: Arc::new(found) }, done, end)
            }
            None => {
                let bytes = header_bytes(MAGIC, &header, Blocks::Plain);
                let start_over = |file: &mut File| {
                    file.set_len(0)?;
                    file.seek(SeekFrom::Start(0))?;
                    file.write_all(&bytes)
                };
                start_over(&mut file).map_err(at("cannot write", path))?;
                let header = Arc::new(header);
                (Part { path: path.into(), file, seal: Seal::Checksum, header }, Vec::new(), bytes.len())
            }
        };
        // Whatever a kill has left half-written behind the last whole record goes.
        let cut = part.file.set_len(end as u64).and_then(|()| (&part.file).seek(SeekFrom::End(0)));
        cut.map_err(at("cannot write", path))?;
        Ok((part, done))
    }

    /// `number` counts through all matrices.
    pub fn append(&mut self, number: usize, factors: &[Arc<BlockFactors>]) -> Result<(), ArchiveError> {
        let bytes = record(number, factors, self.seal);
        self.file.write_all(&bytes).map_err(at("cannot write", &self.path))
    }

    /// Deletes the file while it is still locked, so that no other bake takes it up on its way out.
    pub fn remove(self) {
        // The result is safe already; a leftover only costs space.
        let _ = fs::remove_file(&self.path);
    }
}

/// The file under a path, created if need be, with its lock held.
pub(super) fn locked(path: &Path) -> Result<File, ArchiveError> {
    loop {
        let options = OpenOptions::new().read(true).write(true).create(true).truncate(false).clone();
        let file = options.open(path).map_err(at("cannot create", path))?;
        match file.try_lock() {
            Err(fs::TryLockError::WouldBlock) => return Err(ArchiveError::Busy { path: path.into() }),
            // A file system without locks: go on without.
            Err(fs::TryLockError::Error(_)) | Ok(()) => {}
        }
        // Between opening and locking, the bake that held it may have ended and deleted it.
        if is_at(&file, path).map_err(at("cannot read", path))? {
            return Ok(file);
        }
    }
}

/// Whether an open file is the one that a path names.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    let opened = file.metadata()?;
    match fs::metadata(path) {
        Ok(named) => Ok((opened.dev(), opened.ino()) == (named.dev(), named.ino())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

/// A file that is open keeps its name here.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> io::Result<bool> {
    Ok(true)
}

/// Header, start of the records and their kind; `None` where nothing was begun that could be taken up.
pub(super) fn understood(bytes: &[u8], path: &Path) -> Result<Option<(BakeHeader, usize, Seal)>, ArchiveError> {
    for (magic, seal) in [(MAGIC, Seal::Checksum), (OLD_MAGIC, Seal::Nothing)] {
        match parse_header(magic, bytes, path) {
            Ok((header, offset, Blocks::Plain)) => return Ok(Some((header, offset, seal))),
            Ok((_, _, Blocks::Packed | Blocks::PackedWithZeros)) => {
                return Err(ArchiveError::InTheWay { path: path.into() });
            }
            Err(ArchiveError::NotATransport { .. }) => {}
            // Cut off before its first record, or useless without a header that can be trusted.
            Err(ArchiveError::Damaged { .. }) => return Ok(None),
            Err(newer) => return Err(newer),
        }
    }
    let is_begun = MAGIC.starts_with(bytes) || OLD_MAGIC.starts_with(bytes);
    if is_begun { Ok(None) } else { Err(ArchiveError::InTheWay { path: path.into() }) }
}

/// What is there of the bake that is asked for: its header, how its records end, its blocks, and where they end. `None` where nothing is,
/// and of another bake that was stopped before its first block.
///
/// # Errors
/// If blocks of another bake are there, or the file is no half-done bake.
fn begun(
    bytes: &[u8],
    path: &Path,
    asked: &BakeHeader,
) -> Result<Option<(BakeHeader, Seal, Done, usize)>, ArchiveError> {
    let Some((found, offset, seal)) = understood(bytes, path)? else { return Ok(None) };
    let (done, end) = read_records(bytes, offset, seal, &found);
    match difference(&found, asked) {
        None => Ok(Some((found, seal, done, end))),
        Some(_) if done.is_empty() => Ok(None),
        Some(difference) => Err(ArchiveError::OtherBake { path: path.into(), difference }),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "blocks of a bake are counted in 32 bits")]
fn record(number: usize, factors: &[Arc<BlockFactors>], seal: Seal) -> Vec<u8> {
    let mut bytes = (number as u32).to_le_bytes().to_vec();
    for factors in factors {
        encode_block(factors, &mut bytes);
    }
    if seal == Seal::Checksum {
        let sum = checksum(&bytes);
        bytes.extend(sum.to_le_bytes());
    }
    bytes
}

/// Whole records of a half-done bake, and where they end.
pub(super) fn read_records(bytes: &[u8], mut offset: usize, seal: Seal, header: &BakeHeader) -> (Done, usize) {
    // Memory is asked for in proportion to the records alone, whatever size the header tells.
    let (mut done, mut numbers) = (Done::new(), HashSet::new());
    let partitions = header.partitions();
    while let Some((index, blocks)) = bytes[offset..].split_first_chunk::<INDEX_LEN>() {
        let number = u32::from_le_bytes(*index) as usize;
        let Some((matrix, block_idx)) = locate(&partitions, number) else { break };
        if !numbers.insert(number) {
            break;
        }
        let read = read_block(blocks, &header.basis.groups, &partitions[matrix], block_idx);
        let Ok((factors, len)) = read else { break };
        let Some(end) = offset.checked_add(INDEX_LEN).and_then(|end| end.checked_add(len)) else { break };
        let Some(end) = sealed_end(bytes, offset..end, seal) else { break };
        let Some(factors) = factors.into_iter().collect::<Option<Vec<_>>>() else { break };
        done.push((number, factors));
        offset = end;
    }
    (done, offset)
}

/// Where a record ends, `None` if its seal does not fit.
fn sealed_end(bytes: &[u8], content: std::ops::Range<usize>, seal: Seal) -> Option<usize> {
    match seal {
        Seal::Nothing => Some(content.end),
        Seal::Checksum => {
            let end = content.end.checked_add(CHECKSUM_LEN)?;
            let stored = bytes.get(content.end..end)?;
            (*stored == checksum(&bytes[content]).to_le_bytes()).then_some(end)
        }
    }
}

/// What differs between a half-done bake and the one that is asked for, in words.
pub(super) fn difference(found: &BakeHeader, asked: &BakeHeader) -> Option<String> {
    let (column_scale, sky_reach) = (found.column_scale.clone(), found.sky_reach.clone());
    let same_rows = found.irradiance.iter().map(|set| &set.rows).eq(asked.irradiance.iter().map(|set| &set.rows));
    let irradiance = if same_rows { found.irradiance.clone() } else { asked.irradiance.clone() };
    let (spared, grounds) = (found.spared.clone(), found.grounds.clone());
    // Learned anew on another machine, patches may differ by rounding.
    let same_lights = found.basis.is_alike(&asked.basis);
    let same_patches = found.config.patches == asked.config.patches && same_lights;
    let patches = if same_patches { found.patches.clone() } else { asked.patches.clone() };
    let basis = if same_lights { found.basis.clone() } else { asked.basis.clone() };
    let same_scale =
        BakeHeader { basis, column_scale, sky_reach, irradiance, patches, spared, grounds, ..asked.clone() };
    let settings = [found, asked].map(|header| header.grounds.as_ref().map(|grounds| &grounds.settings));
    let same_settings = found.config == asked.config && found.skips == asked.skips;
    let is_of_other_program = same_settings && settings[0] != settings[1];
    if *found == same_scale && !is_of_other_program {
        return None;
    }
    let what_changed =
        if asked.basis.is_measured() { "the pictures have changed" } else { "the scene or camera has changed" };
    let sizes = (found.width, found.height) != (asked.width, asked.height);
    let checks = [
        (found.fingerprint != asked.fingerprint, what_changed.to_string()),
        (sizes, format!("its size is {}x{}", found.width, found.height)),
        (!same_lights, "its lights differ".into()),
        (found.skips != asked.skips, "it skips other work".into()),
        (!same_rows, "its rows of irradiance differ".into()),
        (is_of_other_program, "another version of the program began it".into()),
        (found.config != asked.config, format!("its options are {:?}", found.config)),
        (found.scene != asked.scene, format!("its scene is {}", found.scene)),
    ];
    let differences: Vec<String> = checks.into_iter().filter(|(differs, _)| *differs).map(|(_, what)| what).collect();
    // The rest comes with columns of an earlier bake.
    Some(if differences.is_empty() { TAKEN_OVER.into() } else { differences.join(", ") })
}

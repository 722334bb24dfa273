//! `.transport` files, and bakes that survive being stopped.
//!
//! A file is `CLERTRAN`, a version, the header as JSON, the map of the sky if there is one, then every group of columns of the
//! picture and of each matrix of irradiance, packed block by block, each block with its own checksum.
//! While a bake runs, finished blocks are appended to `FILE.part`; the same bake takes them up again. At the end the file
//! is written in order under a temporary name and renamed, so that it is whole or not there, and the same bake gives the
//! same bytes whether it was interrupted or not. `docs/format.md` tells both files byte by byte.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

pub mod beside;
mod header;
mod part;
#[cfg(test)]
mod tests;
mod under_way;

use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clerestory_nystrom::codec::{CodecError, MIN_BLOCK_BYTES, decode_block, encode_block};
use clerestory_nystrom::{BlockFactors, PackedMatrix, Partition};
use header::{Blocks, header_bytes, parse_header};
use part::{Done, Part};
pub use part::{PartState, part_state};
use thiserror::Error;
pub use under_way::UnderWay;

use crate::bake::focus::Focus;
use crate::bake::reuse::Reuse;
use crate::bake::stack::SurveyedStack;
use crate::bake::{Bake, BakeError, BakeEvent, BakeHeader, BakeJob, Grounds, PackedMatrices, Passes};
use crate::basis::ColumnGroup;
use crate::irradiance::first_block;
use crate::matrix::CHANNELS;

const MAGIC: &[u8; 8] = b"CLERTRAN";
/// Newest version that is read: its packed blocks tell which pixels are zero, and stay so.
const VERSION: u32 = 9;

/// Side of a packed tile that is believed.
const MAX_TILE: u32 = 256;
/// Memory of factors that a file is believed to hold.
const MAX_UNPACKED_BYTES: u64 = 64 << 30;

/// Why a `.transport` file cannot be read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ArchiveError {
    /// The operating system says no.
    #[error("{doing} `{path}`: {source}{advice}", advice = advice_on(.source))]
    Io {
        /// What was tried.
        doing: &'static str,
        /// Which file.
        path: PathBuf,
        /// Its answer.
        source: io::Error,
    },
    /// The operating system does not let a finished bake be read.
    #[error("cannot read `{path}`: {source}; check the path and that it may be read")]
    Read {
        /// Which file.
        path: PathBuf,
        /// Its answer.
        source: io::Error,
    },
    /// Not a file of ours.
    #[error("`{path}` is not a .transport file; make one with `clerestory bake SCENE -o FILE.transport`")]
    NotATransport {
        /// Which file.
        path: PathBuf,
    },
    /// Written by a later program.
    #[error("`{path}` has format version {version}, this program reads {VERSION}; update the program or bake again")]
    Version {
        /// Which file.
        path: PathBuf,
        /// Its version.
        version: u32,
    },
    /// Cut off or changed.
    #[error("`{path}` is damaged ({what}); bake it again")]
    Damaged {
        /// Which file.
        path: PathBuf,
        /// What does not fit.
        what: String,
    },
    /// More than is believed of a file, whose bytes may stand for a thousand times as many.
    #[error("`{path}` would take {gigabytes} GB of memory; a bake may take {most} here")]
    TooLarge {
        /// Which file.
        path: PathBuf,
        /// Memory of its factors.
        gigabytes: u64,
        /// Memory that is believed.
        most: u64,
    },
    /// A half-done bake of something else is in the way.
    #[error("`{path}` belongs to another bake ({difference}); finish that one, or start over with --fresh")]
    OtherBake {
        /// The half-done bake.
        path: PathBuf,
        /// What differs.
        difference: String,
    },
    /// Something that is no half-done bake stands where one would be kept.
    #[error("`{path}` is in the way and is no half-done bake; move it, or start over with --fresh")]
    InTheWay {
        /// The file.
        path: PathBuf,
    },
    /// Another process bakes to the same file.
    #[error("`{path}` is being written by another bake; wait for it or choose another output file")]
    Busy {
        /// The half-done bake.
        path: PathBuf,
    },
}

/// Whether a half-done bake is taken up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Restart {
    /// Take up what is there.
    Resume,
    /// Start over.
    Fresh,
}

/// What to do about it, where the system's answer leaves that open.
fn advice_on(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
            "; make room on the disk and run the same command again: it goes on with what is done"
        }
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => "; choose a folder that can be written",
        _ => "",
    }
}

fn at(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> ArchiveError {
    let path = path.to_path_buf();
    move |source| ArchiveError::Io { doing, path, source }
}

/// Bytes of a file before its blocks.
pub(crate) fn header_len(header: &BakeHeader) -> u64 {
    header_bytes(MAGIC, header, Blocks::Packed).len() as u64
}

/// Where a bake to `path` keeps what is done.
pub fn part_of(path: &Path) -> PathBuf {
    with_suffix(path, ".part")
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

/// Bakes to `path`. What is done is kept in `path.part` when the bake is stopped or killed, and taken up by the next call
/// with the same job.
///
/// # Errors
/// See [`BakeError`]; a full disk or a half-done bake of another job is an [`ArchiveError`].
pub fn bake_to_file(
    job: BakeJob,
    path: &Path,
    restart: Restart,
    on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send,
) -> Result<Option<Bake>, BakeError> {
    let (header, writing) = (job.header()?, Writing::of(&job));
    keep(header, (path, restart, writing), on_event, |header, done, on_event| {
        job.run_from(header, done, &Focus::default(), on_event)
    })
}

/// The same with what can be taken over from an earlier bake: only the rest is traced, and kept half-done.
///
/// # Errors
/// As [`bake_to_file`].
pub fn rebake_to_file(
    job: BakeJob,
    reuse: &Reuse,
    path: &Path,
    restart: Restart,
    on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send,
) -> Result<Option<Bake>, BakeError> {
    if reuse.n_added_rows() > 0 {
        let job = reuse.regrouped(job);
        let header = reuse.header_with_rows(&job, &Focus::default())?;
        return keep(header, (path, restart, Writing::of(&job)), on_event, |header, done, mut on_event| {
            job.run_rows(reuse, &header, done, &Focus::default(), &mut on_event)
        });
    }
    let Some(job) = reuse.rest_of(job) else {
        let bake = reuse.join(None);
        write(&bake, path)?;
        return Ok(Some(bake));
    };
    let (header, writing) = (job.header()?, Writing::of(&job));
    keep(header, (path, restart, writing), on_event, |header, done, on_event| {
        let new = job.run_from(header, done, &Focus::default(), on_event)?;
        Ok(new.map(|new| reuse.join(Some(new))))
    })
}

/// The same for a measured stack.
///
/// # Errors
/// As [`bake_to_file`].
pub fn stack_to_file(
    stack: SurveyedStack,
    path: &Path,
    restart: Restart,
    on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send,
) -> Result<Option<Bake>, BakeError> {
    // While it is half-done it tells which program began it, so that no other goes on with it.
    let header = BakeHeader { grounds: Some(Grounds::of_program()), ..stack.header().clone() };
    let place = (path, restart, Writing::Blocks);
    keep(header, place, on_event, |header, done, on_event| {
        let header = BakeHeader { grounds: None, ..Arc::unwrap_or_clone(header) };
        stack.run_from(Arc::new(header), done, on_event)
    })
}

/// Who hears of a bake.
pub(crate) type Listener<'a> = &'a mut (dyn FnMut(BakeEvent) -> ControlFlow<()> + Send);

/// What is written down of a bake while it runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Writing {
    /// Blocks of its last pass.
    Blocks,
    /// Nothing: within a time, these alone are no start.
    Nothing,
}

impl Writing {
    fn of(job: &BakeJob) -> Writing {
        if matches!(job.passes, Passes::Until(_)) { Writing::Nothing } else { Writing::Blocks }
    }
}

/// Runs a bake that is given its header and what is done already; keeps every block as it comes.
#[expect(clippy::arithmetic_side_effects, reason = "a bake has a pass, and its blocks are counted in memory")]
fn keep(
    header: BakeHeader,
    (path, restart, writing): (&Path, Restart, Writing),
    mut on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send,
    run: impl FnOnce(Arc<BakeHeader>, &Done, Listener) -> Result<Option<Bake>, BakeError>,
) -> Result<Option<Bake>, BakeError> {
    let (mut part, done) = Part::open(&part_of(path), header, restart)?;
    let (mut failure, mut last_pass) = (None, None);
    let header = part.header.clone();
    let n_done = done.len();
    let mut replayed = 0;
    let partitions = header.partitions();
    let bake = run(header, &done, &mut |event| {
        let mut finished = None;
        match &event {
            BakeEvent::Started { n_passes, .. } if writing == Writing::Blocks => last_pass = Some(n_passes - 1),
            BakeEvent::BlockDone { pass, block_idx, factors } if Some(*pass) == last_pass => {
                finished = Some((0, *block_idx, factors));
            }
            BakeEvent::IrradianceDone { set, block_idx, factors, is_preview: false } => {
                finished = Some((1 + set, *block_idx, factors));
            }
            _ => {}
        }
        if let Some((matrix, block_idx, factors)) = finished {
            // What was there before is told first.
            if replayed < n_done {
                replayed += 1;
            } else if let Err(error) = part.append(first_block(&partitions, matrix) + block_idx, factors) {
                failure = Some(error);
                return ControlFlow::Break(());
            }
        }
        on_event(event)
    })?;
    if let Some(error) = failure {
        return Err(error.into());
    }
    if let Some(bake) = &bake {
        write(bake, path)?;
        part.remove();
    }
    Ok(bake)
}

/// Writes a finished bake; the file is whole or not there. Where the path is a symbolic link, what it leads to is written.
///
/// # Errors
/// [`ArchiveError::Io`].
pub fn write(bake: &Bake, path: &Path) -> Result<(), ArchiveError> {
    let path = &beside::followed(path).map_err(at("cannot follow", path))?;
    let (temporary, file) = beside::temporary(path).map_err(at("cannot create", path))?;
    let written = write_all(bake, file, &temporary)
        .and_then(|()| fs::rename(&temporary, path).map_err(at("cannot rename to", path)));
    if written.is_err() {
        let _ = fs::remove_file(&temporary);
    }
    written
}

fn write_all(bake: &Bake, file: File, path: &Path) -> Result<(), ArchiveError> {
    let mut out = BufWriter::new(file);
    if let Some(packed) = &bake.packed {
        let tells_zeros = packed.iter().flatten().any(PackedMatrix::tells_zeros);
        let blocks = if tells_zeros { Blocks::PackedWithZeros } else { Blocks::Packed };
        let mut bytes = header_bytes(MAGIC, &bake.header, blocks);
        packed.iter().flatten().for_each(|group| group.encode(&mut bytes));
        out.write_all(&bytes).map_err(at("cannot write", path))?;
        return finish(out, path);
    }
    let mut bytes = header_bytes(MAGIC, &bake.header, Blocks::Plain);
    let absent = BlockFactors::default();
    let matrices = std::iter::once(&bake.groups).chain(&bake.irradiance);
    for (groups, partition) in matrices.zip(bake.header.partitions()) {
        for block_idx in 0..partition.n_blocks() {
            for group in groups {
                encode_block(group.blocks[block_idx].as_deref().unwrap_or(&absent), &mut bytes);
            }
            out.write_all(&bytes).map_err(at("cannot write", path))?;
            bytes.clear();
        }
    }
    finish(out, path)
}

fn finish(out: BufWriter<File>, path: &Path) -> Result<(), ArchiveError> {
    let file = out.into_inner().map_err(|e| at("cannot write", path)(e.into_error()))?;
    file.sync_all().map_err(at("cannot write", path))
}

/// Reads a finished bake; every checksum is verified.
///
/// # Errors
/// See [`ArchiveError`].
pub fn read(path: &Path) -> Result<Bake, ArchiveError> {
    read_within(None, path)
}

/// The same on a machine that has so much memory, bytes, where that is known: a file whose factors would take more is refused.
///
/// # Errors
/// See [`ArchiveError`].
pub fn read_within(memory_bytes: Option<u64>, path: &Path) -> Result<Bake, ArchiveError> {
    let bytes = fs::read(path).map_err(|source| ArchiveError::Read { path: path.into(), source })?;
    decode_within(memory_bytes, &bytes, path)
}

/// Whether a file begins as `.transport` files do, whatever it is called. Of a pipe nothing is read.
pub fn is_transport(path: &Path) -> bool {
    let mut start = [0; MAGIC.len()];
    let is_read = path.is_file() && File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok();
    is_read && start == *MAGIC
}

/// Reads a finished bake from memory; `path` is for people.
///
/// # Errors
/// See [`ArchiveError`].
pub fn decode(bytes: &[u8], path: &Path) -> Result<Bake, ArchiveError> {
    decode_within(None, bytes, path)
}

fn decode_within(memory_bytes: Option<u64>, bytes: &[u8], path: &Path) -> Result<Bake, ArchiveError> {
    let (header, offset, blocks) = parse_header(MAGIC, bytes, path)?;
    if blocks == Blocks::Packed {
        let most = memory_bytes.unwrap_or(u64::MAX).min(MAX_UNPACKED_BYTES);
        return decode_packed(header, &bytes[offset..], path, most);
    }
    let n_blocks: usize = header.partitions().iter().map(Partition::n_blocks).sum();
    // An absent block too has its bytes, so that memory is asked for in proportion to the file alone.
    let least = n_blocks.saturating_mul(header.basis.groups.len()).saturating_mul(MIN_BLOCK_BYTES);
    if least > bytes[offset..].len() {
        return Err(damaged(path, "it has fewer blocks than its header says".into()));
    }
    let (mut matrices, mut rest) = (header.empty_matrices(), &bytes[offset..]);
    for (groups, partition) in matrices.iter_mut().zip(header.partitions()) {
        for block_idx in 0..partition.n_blocks() {
            let read = read_block(rest, &header.basis.groups, &partition, block_idx);
            let (blocks, len) = read.map_err(|error| damaged(path, error.to_string()))?;
            groups.iter_mut().zip(blocks).for_each(|(group, block)| group.blocks[block_idx] = block);
            rest = &rest[len..];
        }
    }
    if !rest.is_empty() {
        return Err(damaged(path, "it is longer than its header says".into()));
    }
    let groups = matrices.remove(0);
    Ok(Bake { header: Arc::new(header), groups, irradiance: matrices, packed: None })
}

/// Reads the packed matrices behind a header, unless their factors would take more than `most` bytes.
#[expect(clippy::cast_possible_truncation, reason = "three")]
fn decode_packed(header: BakeHeader, bytes: &[u8], path: &Path, most: u64) -> Result<Bake, ArchiveError> {
    let wrong = |error: CodecError| damaged(path, error.to_string());
    if header.tile > MAX_TILE {
        return Err(damaged(path, "its header has impossibly large tiles".into()));
    }
    let (mut packed, mut rest, mut n_unpacked) = (PackedMatrices::new(), bytes, 0u64);
    for (partition, plans) in header.partitions().iter().zip(header.pack_plans()) {
        let mut groups = Vec::new();
        for plan in plans {
            let read = PackedMatrix::decode(rest, partition.clone(), CHANNELS as u32, plan.columns);
            let (group, len) = read.map_err(wrong)?;
            let n_bytes = group.unpacked_bytes().map_err(wrong)?;
            let sum = n_unpacked.checked_add(n_bytes);
            n_unpacked = sum.ok_or_else(|| damaged(path, "its blocks are impossibly large".into()))?;
            rest = &rest[len..];
            groups.push(group);
        }
        packed.push(groups);
    }
    if !rest.is_empty() {
        return Err(damaged(path, "it is longer than its header says".into()));
    }
    if n_unpacked > most {
        let (gigabytes, most) = (n_unpacked.div_ceil(1 << 30), most >> 30);
        return Err(ArchiveError::TooLarge { path: path.into(), gigabytes, most });
    }
    Bake::unpacking(Arc::new(header), packed).map_err(wrong)
}

fn damaged(path: &Path, what: String) -> ArchiveError {
    ArchiveError::Damaged { path: path.into(), what }
}

/// Factors of one place, one per group of columns; none of a group that has none there.
type Place = Vec<Option<Arc<BlockFactors>>>;

/// The blocks of one place, and their length in bytes.
#[expect(clippy::cast_possible_truncation, reason = "three")]
fn read_block(
    bytes: &[u8],
    groups: &[ColumnGroup],
    partition: &Partition,
    block_idx: usize,
) -> Result<(Place, usize), CodecError> {
    let [.., w, h] = partition.rect(block_idx);
    let n_rows = w.checked_mul(h).and_then(|n| n.checked_mul(CHANNELS as u32));
    let (mut blocks, mut offset) = (Vec::with_capacity(groups.len()), 0usize);
    for group in groups {
        let (factors, len) = decode_block(&bytes[offset..])?;
        let fits = Some(factors.n_rows) == n_rows && factors.n_cols as usize == group.columns.len();
        if !fits && factors != BlockFactors::default() {
            return Err(CodecError::Malformed("a block does not fit its place in the picture"));
        }
        blocks.push(fits.then(|| Arc::new(factors)));
        offset = offset.checked_add(len).ok_or(CodecError::Malformed("a block is impossibly long"))?;
    }
    Ok((blocks, offset))
}

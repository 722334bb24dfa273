//! `.transport` files, and bakes that survive being stopped.
//!
//! A file is `CLERTRAN`, a version, the header as JSON, the map of the sky if there is one, then every block of every
//! group in order, each with its own checksum: first those of the picture, then those of each matrix of irradiance.
//! While a bake runs, finished blocks are appended to `FILE.part`; the same bake takes them up again. At the end the file
//! is written in order under a temporary name and renamed, so that it is whole or not there, and the same bake gives the
//! same bytes whether it was interrupted or not.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clerestory_nystrom::codec::{CodecError, decode_block, encode_block};
use clerestory_nystrom::{BlockFactors, BlockLowRank};
use thiserror::Error;

use crate::bake::{Bake, BakeError, BakeEvent, BakeHeader, BakeJob};
use crate::basis::SourceKind;
use crate::irradiance::{first_block, locate};
use crate::sky::{DOME_DIVISIONS, Environment, dome_columns};

const MAGIC: &[u8; 8] = b"CLERTRAN";
const PART_MAGIC: &[u8; 8] = b"CLERPART";
/// Newest version that is read: it may hold irradiance.
const VERSION: u32 = 3;
/// Version of a file without irradiance, which older programs read.
const PLAIN_VERSION: u32 = 2;
/// Oldest version that is read: it knows no sky.
const OLDEST_VERSION: u32 = 1;
/// Longest header that is believed.
const MAX_HEADER_BYTES: u32 = 256 << 20;

/// Why a `.transport` file cannot be read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ArchiveError {
    /// The operating system says no.
    #[error("{doing} `{path}`: {source}")]
    Io {
        /// What was tried.
        doing: &'static str,
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
    /// A half-done bake of something else is in the way.
    #[error("`{path}` belongs to another bake ({difference}); finish that one, or start over with --fresh")]
    OtherBake {
        /// The half-done bake.
        path: PathBuf,
        /// What differs.
        difference: String,
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

fn at(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> ArchiveError {
    let path = path.to_path_buf();
    move |source| ArchiveError::Io { doing, path, source }
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
    mut on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send,
) -> Result<Option<Bake>, BakeError> {
    let header = job.header()?;
    let (mut part, done) = Part::open(&part_of(path), header, restart)?;
    let (mut failure, mut last_pass) = (None, 0);
    let header = part.header.clone();
    let n_done = done.len();
    let mut replayed = 0;
    let partitions = header.partitions();
    let bake = job.run_from(header, &done, |event| {
        let mut finished = None;
        match &event {
            BakeEvent::Started { n_passes, .. } => last_pass = n_passes - 1,
            BakeEvent::BlockDone { pass, block_idx, factors } if *pass == last_pass => {
                finished = Some((0, *block_idx, factors));
            }
            BakeEvent::IrradianceDone { set, block_idx, factors } => finished = Some((1 + set, *block_idx, factors)),
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

/// Writes a finished bake; the file is whole or not there.
///
/// # Errors
/// [`ArchiveError::Io`].
pub fn write(bake: &Bake, path: &Path) -> Result<(), ArchiveError> {
    let temporary = with_suffix(path, ".tmp");
    let written =
        write_all(bake, &temporary).and_then(|()| fs::rename(&temporary, path).map_err(at("cannot rename to", path)));
    if written.is_err() {
        let _ = fs::remove_file(&temporary);
    }
    written
}

fn write_all(bake: &Bake, path: &Path) -> Result<(), ArchiveError> {
    let file = File::create(path).map_err(at("cannot create", path))?;
    let mut out = BufWriter::new(file);
    let mut bytes = header_bytes(MAGIC, &bake.header);
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
    let file = out.into_inner().map_err(|e| at("cannot write", path)(e.into_error()))?;
    file.sync_all().map_err(at("cannot write", path))
}

fn header_bytes(magic: &[u8; 8], header: &BakeHeader) -> Vec<u8> {
    let json = serde_json::to_vec(header).expect("a header has only string keys and plain values");
    let mut bytes = magic.to_vec();
    let version = if header.irradiance.is_empty() { PLAIN_VERSION } else { VERSION };
    bytes.extend(version.to_le_bytes());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(json);
    if let Some(sky) = &header.basis.sky {
        bytes.extend(sky.map.encode());
    }
    bytes
}

/// Reads a finished bake.
///
/// # Errors
/// See [`ArchiveError`].
pub fn read(path: &Path) -> Result<Bake, ArchiveError> {
    let bytes = fs::read(path).map_err(at("cannot read", path))?;
    let (header, mut offset) = parse_header(MAGIC, &bytes, path)?;
    let mut matrices = header.empty_matrices();
    for (groups, partition) in matrices.iter_mut().zip(header.partitions()) {
        for block_idx in 0..partition.n_blocks() {
            offset +=
                read_block(&bytes[offset..], groups, block_idx).map_err(|error| damaged(path, error.to_string()))?;
        }
    }
    if offset != bytes.len() {
        return Err(damaged(path, "it is longer than its header says".into()));
    }
    let groups = matrices.remove(0);
    Ok(Bake { header: Arc::new(header), groups, irradiance: matrices })
}

fn damaged(path: &Path, what: String) -> ArchiveError {
    ArchiveError::Damaged { path: path.into(), what }
}

fn parse_header(magic: &[u8; 8], bytes: &[u8], path: &Path) -> Result<(BakeHeader, usize), ArchiveError> {
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    if bytes.get(..8) != Some(magic) {
        return Err(ArchiveError::NotATransport { path: path.into() });
    }
    let version = word(8).ok_or_else(|| damaged(path, "it ends in its header".into()))?;
    if !(OLDEST_VERSION..=VERSION).contains(&version) {
        return Err(ArchiveError::Version { path: path.into(), version });
    }
    let len =
        word(12).filter(|&len| len <= MAX_HEADER_BYTES).ok_or_else(|| damaged(path, "it ends in its header".into()))?;
    let json = bytes.get(16..16 + len as usize).ok_or_else(|| damaged(path, "it ends in its header".into()))?;
    let mut header: BakeHeader = serde_json::from_slice(json).map_err(|e| damaged(path, format!("its header: {e}")))?;
    check_header(&header).map_err(|what| damaged(path, what.into()))?;
    let mut offset = 16 + len as usize;
    if let Some(sky) = &mut header.basis.sky {
        let map = Environment::decode(&bytes[offset..]);
        let (map, len) = map.ok_or_else(|| damaged(path, "the map of its sky".into()))?;
        sky.map = Arc::new(map);
        offset += len;
    }
    Ok((header, offset))
}

/// A header that the rest of the program can trust.
fn check_header(header: &BakeHeader) -> Result<(), &'static str> {
    let max = crate::camera::Film::MAX_SIDE;
    let basis = &header.basis;
    if header.width == 0 || header.height == 0 || header.width > max || header.height > max || header.tile == 0 {
        return Err("its header has an impossible size");
    }
    let mut next = 0;
    for source in &basis.sources {
        if source.columns.start != next || source.columns.end < next {
            return Err("its header has columns out of order");
        }
        next = source.columns.end;
        let texels = match source.kind {
            SourceKind::Panel { resolution, .. } => resolution.saturating_mul(resolution),
            SourceKind::Dome { divisions } if !DOME_DIVISIONS.contains(&divisions) => {
                return Err("its header has a sky of unknown patches");
            }
            SourceKind::Dome { divisions } => dome_columns(divisions),
            _ => 1,
        };
        if source.columns.len() as u32 != texels {
            return Err("its header has a light with missing columns");
        }
    }
    let mut next = 0;
    for group in &basis.groups {
        if group.columns.start != next || group.columns.end < next {
            return Err("its header has groups out of order");
        }
        next = group.columns.end;
    }
    if next as usize != basis.n_cols() || header.column_scale.len() != basis.n_cols() {
        return Err("its header has columns without a group or a scale");
    }
    if header.column_scale.iter().any(|s| !s.is_finite() || *s <= 0.0) {
        return Err("its header has an impossible scale");
    }
    if header.sky_reach.iter().any(|reach| !reach.is_finite() || *reach < 0.0) {
        return Err("its header has an impossible reach of the sky");
    }
    if header.view.as_ref().is_some_and(|view| !view.world_from_camera.is_finite() || !view.yfov_rad.is_finite()) {
        return Err("its header has an impossible camera");
    }
    if basis.sky.as_ref().is_some_and(|sky| !sky.is_finite()) {
        return Err("its header has an impossible sky");
    }
    header.check_irradiance()
}

fn read_block(bytes: &[u8], groups: &mut [BlockLowRank], block_idx: usize) -> Result<usize, CodecError> {
    let mut offset = 0;
    for group in groups {
        let (factors, len) = decode_block(&bytes[offset..])?;
        let [.., w, h] = group.partition.rect(block_idx);
        let fits = factors.n_rows == w * h * group.bundle_len && factors.n_cols == group.n_cols;
        if fits {
            group.blocks[block_idx] = Some(Arc::new(factors));
        } else if factors != BlockFactors::default() {
            return Err(CodecError::Malformed("a block does not fit its place in the picture"));
        }
        offset += len;
    }
    Ok(offset)
}

/// A bake under way: header, then blocks as they were finished.
struct Part {
    path: PathBuf,
    file: File,
    header: Arc<BakeHeader>,
}

type Done = Vec<(usize, Vec<Arc<BlockFactors>>)>;

impl Part {
    /// Opens or creates the file; takes up its blocks if it belongs to the same bake. The lock is the operating system's:
    /// it ends with the process that holds it.
    fn open(path: &Path, header: BakeHeader, restart: Restart) -> Result<(Part, Done), ArchiveError> {
        let options = OpenOptions::new().read(true).write(true).create(true).truncate(false).clone();
        let mut file = options.open(path).map_err(at("cannot create", path))?;
        match file.try_lock() {
            Err(fs::TryLockError::WouldBlock) => return Err(ArchiveError::Busy { path: path.into() }),
            // A file system without locks: go on without.
            Err(fs::TryLockError::Error(_)) | Ok(()) => {}
        }
        let mut bytes = Vec::new();
        if restart == Restart::Resume {
            file.read_to_end(&mut bytes).map_err(at("cannot read", path))?;
        }
        let found = parse_header(PART_MAGIC, &bytes, path).ok();
        let (header, done, end) = match found {
            Some((found, offset)) => {
                if let Some(difference) = difference(&found, &header) {
                    return Err(ArchiveError::OtherBake { path: path.into(), difference });
                }
                let (done, end) = read_part(&bytes, offset, &found);
                (found, done, end)
            }
            None => {
                let bytes = header_bytes(PART_MAGIC, &header);
                file.set_len(0).map_err(at("cannot write", path))?;
                file.seek(SeekFrom::Start(0)).map_err(at("cannot write", path))?;
                file.write_all(&bytes).map_err(at("cannot write", path))?;
                (header, Vec::new(), bytes.len())
            }
        };
        // Whatever a kill has left half-written behind the last whole block goes.
        file.set_len(end as u64).map_err(at("cannot write", path))?;
        file.seek(SeekFrom::End(0)).map_err(at("cannot write", path))?;
        Ok((Part { path: path.into(), file, header: Arc::new(header) }, done))
    }

    /// `number` counts through all matrices.
    fn append(&mut self, number: usize, factors: &[Arc<BlockFactors>]) -> Result<(), ArchiveError> {
        let mut bytes = (number as u32).to_le_bytes().to_vec();
        for factors in factors {
            encode_block(factors, &mut bytes);
        }
        self.file.write_all(&bytes).map_err(at("cannot write", &self.path))
    }

    fn remove(self) {
        drop(self.file);
        // The result is safe already; a leftover only costs space.
        let _ = fs::remove_file(&self.path);
    }
}

/// Whole blocks of a half-done bake, and where they end.
fn read_part(bytes: &[u8], mut offset: usize, header: &BakeHeader) -> (Done, usize) {
    let (mut done, mut matrices) = (Done::new(), header.empty_matrices());
    let partitions = header.partitions();
    while let Some(index) = bytes.get(offset..offset + 4) {
        let number = u32::from_le_bytes([index[0], index[1], index[2], index[3]]) as usize;
        let Some((matrix, block_idx)) = locate(&partitions, number) else { break };
        let groups = &mut matrices[matrix];
        if groups.first().is_some_and(|g| g.blocks[block_idx].is_some()) {
            break;
        }
        let Ok(len) = read_block(&bytes[offset + 4..], groups, block_idx) else { break };
        let factors: Option<Vec<_>> = groups.iter().map(|g| g.blocks[block_idx].clone()).collect();
        let Some(factors) = factors else { break };
        done.push((number, factors));
        offset += 4 + len;
    }
    (done, offset)
}

/// What differs between a half-done bake and the one that is asked for, in words.
fn difference(found: &BakeHeader, asked: &BakeHeader) -> Option<String> {
    let (column_scale, sky_reach) = (found.column_scale.clone(), found.sky_reach.clone());
    let same_rows = found.irradiance.iter().map(|set| &set.rows).eq(asked.irradiance.iter().map(|set| &set.rows));
    let irradiance = if same_rows { found.irradiance.clone() } else { asked.irradiance.clone() };
    let spared = found.spared.clone();
    let same_scale = BakeHeader { column_scale, sky_reach, irradiance, spared, ..asked.clone() };
    if *found == same_scale {
        return None;
    }
    let sizes = (found.width, found.height) != (asked.width, asked.height);
    let checks = [
        (found.fingerprint != asked.fingerprint, "the scene or camera has changed".to_string()),
        (sizes, format!("its size is {}x{}", found.width, found.height)),
        (found.basis != asked.basis, "its lights differ".into()),
        (found.skips != asked.skips, "it skips other work".into()),
        (!same_rows, "its rows of irradiance differ".into()),
        (found.config != asked.config, format!("its options are {:?}", found.config)),
        (found.scene != asked.scene, format!("its scene is {}", found.scene)),
    ];
    let differences: Vec<String> = checks.into_iter().filter(|(differs, _)| *differs).map(|(_, what)| what).collect();
    Some(differences.join(", "))
}

//! A bake that somebody watches, kept on the side: its blocks go to a file as they come, and whoever makes the same bake again,
//! in another process too, goes on with them. What cannot be kept costs the bake nothing.

use std::collections::HashSet;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clerestory_nystrom::BlockFactors;

use super::part::{MAGIC, Part, Seal, difference, locked, read_records, understood};
use super::{ArchiveError, Blocks, at, header_bytes, part_of};
use crate::bake::{BakeEvent, BakeHeader, HalfDone};
use crate::irradiance::first_block;

/// The file of a bake under way, which this process writes to and no other.
pub struct UnderWay {
    path: PathBuf,
    /// Until the bake begins.
    file: Option<File>,
    /// What an earlier process left, and where its records end.
    found: Option<(Arc<BakeHeader>, u64)>,
    part: Option<Part>,
    /// Number of the last pass.
    last_pass: u32,
    /// Blocks that are in the file.
    kept: HashSet<usize>,
}

impl UnderWay {
    /// Takes the place beside `path`, where the finished bake will be; and what was begun of it before, if anything. What is no
    /// bake under way is started over.
    ///
    /// # Errors
    /// If the file cannot be made or read, or another process bakes there.
    pub fn beside(path: &Path) -> Result<(UnderWay, Option<HalfDone>), ArchiveError> {
        let path = part_of(path);
        let (mut file, mut bytes) = (locked(&path)?, Vec::new());
        file.read_to_end(&mut bytes).map_err(at("cannot read", &path))?;
        let (mut found, mut kept, mut half_done) = (None, HashSet::new(), None);
        if let Ok(Some((header, offset, Seal::Checksum))) = understood(&bytes, &path) {
            let (blocks, end) = read_records(&bytes, offset, Seal::Checksum, &header);
            let header = Arc::new(header);
            found = Some((header.clone(), end as u64));
            kept = blocks.iter().map(|(number, _)| *number).collect();
            half_done = (!blocks.is_empty()).then_some(HalfDone { header, blocks });
        }
        Ok((UnderWay { path, file: Some(file), found, part: None, last_pass: 0, kept }, half_done))
    }

    /// Keeps what an event brings: blocks of the last pass, each once.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn heed(&mut self, event: &BakeEvent) -> Result<(), ArchiveError> {
        match event {
            BakeEvent::Started { header, n_passes, .. } => {
                self.last_pass = n_passes.saturating_sub(1);
                self.begin(header)
            }
            BakeEvent::BlockDone { pass, block_idx, factors } if *pass == self.last_pass => {
                self.keep(0, *block_idx, factors)
            }
            BakeEvent::IrradianceDone { set, block_idx, factors, is_preview: false } => {
                self.keep(set.saturating_add(1), *block_idx, factors)
            }
            _ => Ok(()),
        }
    }

    /// Goes on behind the records of the same bake; those of another one go, and those of columns in another scale.
    fn begin(&mut self, header: &Arc<BakeHeader>) -> Result<(), ArchiveError> {
        let Some(file) = self.file.take() else { return Ok(()) };
        let end = match self.found.take() {
            Some((found, end)) if difference(&found, header).is_none() && is_in_scale_of(&found, header) => end,
            _ => {
                self.kept.clear();
                let bytes = header_bytes(MAGIC, header, Blocks::Plain);
                start_over(&file, &bytes).map_err(at("cannot write", &self.path))?;
                bytes.len() as u64
            }
        };
        // What a kill has left half-written goes.
        let cut = file.set_len(end).and_then(|()| (&file).seek(SeekFrom::End(0)));
        cut.map_err(at("cannot write", &self.path))?;
        self.part = Some(Part { path: self.path.clone(), file, seal: Seal::Checksum, header: header.clone() });
        Ok(())
    }

    fn keep(&mut self, matrix: usize, block_idx: usize, factors: &[Arc<BlockFactors>]) -> Result<(), ArchiveError> {
        let Some(part) = &mut self.part else { return Ok(()) };
        let number = first_block(&part.header.partitions(), matrix).saturating_add(block_idx);
        if self.kept.insert(number) { part.append(number, factors) } else { Ok(()) }
    }

    /// Removes the file: the bake is whole, elsewhere.
    pub fn remove(self) {
        if let Some(part) = self.part {
            part.remove();
        }
    }
}

/// Whether two bakes of the same thing have their columns in one scale: what takes some over from an earlier bake measures the others alone.
fn is_in_scale_of(found: &BakeHeader, header: &BakeHeader) -> bool {
    let of_sets = found.irradiance.iter().map(|set| &set.column_scale);
    found.column_scale == header.column_scale && of_sets.eq(header.irradiance.iter().map(|set| &set.column_scale))
}

fn start_over(mut file: &File, bytes: &[u8]) -> std::io::Result<()> {
    file.set_len(0)?;
    file.seek(SeekFrom::Start(0))?;
    file.write_all(bytes)
}

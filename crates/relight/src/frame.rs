//! What goes in (a compressed frame) and what comes out (radiance).

use clerestory_nystrom::{BlockFactors, BlockLowRank, Partition};
use rayon::prelude::*;
use std::sync::Arc;

use crate::relight::RelightError;

/// Linear Rec. 709 radiance in nit, row by row from the top left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Radiance {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green, blue; width × height.
    pub pixels: Vec<[f32; 3]>,
}

impl Radiance {
    /// A black picture.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, pixels: vec![[0.0; 3]; width as usize * height as usize] }
    }

    /// Adds another picture of the same size.
    pub fn add(&mut self, more: &Radiance) {
        assert_eq!((self.width, self.height), (more.width, more.height), "pictures of one size");
        let sums = self.pixels.as_flattened_mut().par_iter_mut().zip(more.pixels.as_flattened());
        sums.for_each(|(sum, added)| *sum += added);
    }

    /// Takes the given size; the content is unspecified afterwards where the size is new.
    pub(crate) fn resize(&mut self, width: u32, height: u32) {
        (self.width, self.height) = (width, height);
        self.pixels.resize(width as usize * height as usize, [0.0; 3]);
    }
}

/// A compressed frame: one matrix per group of columns, all over the same tiles. A clone shares the blocks.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Pixels per row.
    pub width: u32,
    /// Rows of pixels.
    pub height: u32,
    /// One per group of columns; rows are `3 · pixel + channel`, the bundle of the partition is the pixel.
    pub groups: Vec<BlockLowRank>,
}

impl Frame {
    /// The tiles, which all groups share; one tile for a frame without groups.
    pub fn partition(&self) -> Partition {
        let (width, height) = (self.width, self.height);
        self.groups.first().map_or(Partition { width, height, tile: width.max(height) }, |g| g.partition.clone())
    }

    /// Whether sizes, tiles and numbers of columns are those of `other`, so that blocks can be exchanged one by one.
    pub fn same_shape(&self, other: &Self) -> bool {
        (self.width, self.height, self.groups.len()) == (other.width, other.height, other.groups.len())
            && self
                .groups
                .iter()
                .zip(&other.groups)
                .all(|(a, b)| (a.n_cols, &a.partition, a.blocks.len()) == (b.n_cols, &b.partition, b.blocks.len()))
    }

    /// Block of a group, if it is there yet.
    pub fn block(&self, group: usize, block: usize) -> Option<&Arc<BlockFactors>> {
        self.groups.get(group)?.blocks.get(block)?.as_ref()
    }

    /// Checks that the groups fit the frame and all blocks fit their tiles.
    ///
    /// # Errors
    /// [`RelightError::Frame`] or [`RelightError::Block`], naming the first that does not fit.
    pub fn check(&self) -> Result<(), RelightError> {
        self.check_shape()?;
        for (group, low_rank) in self.groups.iter().enumerate() {
            (0..low_rank.blocks.len()).try_for_each(|block| self.check_block(group, block))?;
        }
        Ok(())
    }

    /// Takes over the blocks `changed` of a frame of the same shape; all are checked before any is taken.
    pub(crate) fn take_blocks(&mut self, other: &Self, changed: &[(usize, usize)]) -> Result<(), RelightError> {
        for &(group, block) in changed {
            if block >= other.groups.get(group).map_or(0, |g| g.blocks.len()) {
                return Err(RelightError::Frame(format!("there is no block {block} in group {group}")));
            }
            other.check_block(group, block)?;
        }
        for &(group, block) in changed {
            self.groups[group].blocks[block] = other.groups[group].blocks[block].clone();
        }
        Ok(())
    }

    fn check_shape(&self) -> Result<(), RelightError> {
        let fail = |words: String| Err(RelightError::Frame(words));
        if self.width == 0 || self.height == 0 {
            return fail(format!("it has {} × {} pixels", self.width, self.height));
        }
        let partition = self.partition();
        for (group, low_rank) in self.groups.iter().enumerate() {
            let own = &low_rank.partition;
            if own.tile == 0 || (own.width, own.height) != (self.width, self.height) || *own != partition {
                return fail(format!("group {group} is cut into other tiles than the frame"));
            }
            if low_rank.bundle_len != 3 {
                return fail(format!("group {group} has {} rows per pixel instead of 3", low_rank.bundle_len));
            }
            if low_rank.blocks.len() != own.n_blocks() {
                return fail(format!(
                    "group {group} has {} blocks for {} tiles",
                    low_rank.blocks.len(),
                    own.n_blocks()
                ));
            }
        }
        Ok(())
    }

    fn check_block(&self, group: usize, block: usize) -> Result<(), RelightError> {
        let Some(factors) = self.block(group, block) else { return Ok(()) };
        let [_, _, w, h] = self.groups[group].partition.rect(block);
        let (rows, cols, rank) =
            (3 * w as usize * h as usize, self.groups[group].n_cols as usize, factors.rank as usize);
        let fits = [
            ("rows", factors.n_rows as usize, rows),
            ("columns", factors.n_cols as usize, cols),
            ("scales", factors.scale.len(), rank),
            ("left entries", factors.left.len(), rows * rank),
            ("right entries", factors.right.len(), rank * cols),
        ];
        let found = fits.iter().find(|(_, found, expected)| found != expected);
        let reason = match found {
            Some((what, found, expected)) => format!("{found} {what} instead of {expected}"),
            None if factors.sparse.iter().any(|s| s.row as usize >= rows || s.col as usize >= cols) => {
                "a sparse entry lies outside".to_owned()
            }
            None => return Ok(()),
        };
        Err(RelightError::Block { group, block, reason })
    }
}

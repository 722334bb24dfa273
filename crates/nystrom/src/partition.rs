//! Which rows form a block: rectangular tiles of a two-dimensional grid of bundles.

/// Tiles of a grid of bundles; tile and bundle are counted row by row from the top left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Partition {
    /// Bundles in a row of the grid.
    pub width: u32,
    /// Rows of the grid.
    pub height: u32,
    /// Side of a tile in bundles; tiles at the right and lower border may be smaller.
    pub tile: u32,
}

impl Partition {
    /// Tiles per row of tiles.
    pub fn tiles_x(&self) -> u32 {
        self.width.div_ceil(self.tile)
    }

    /// Rows of tiles.
    pub fn tiles_y(&self) -> u32 {
        self.height.div_ceil(self.tile)
    }

    /// Number of blocks.
    pub fn n_blocks(&self) -> usize {
        self.tiles_x() as usize * self.tiles_y() as usize
    }

    /// First column, first row, width and height of a block's tile, in bundles.
    pub fn rect(&self, block_idx: usize) -> [u32; 4] {
        let x = (block_idx as u32 % self.tiles_x()) * self.tile;
        let y = (block_idx as u32 / self.tiles_x()) * self.tile;
        [x, y, self.tile.min(self.width - x), self.tile.min(self.height - y)]
    }

    /// The block that a bundle lies in, and its number there; `None` of what lies beyond the grid.
    pub fn place(&self, bundle: u32) -> Option<(usize, u32)> {
        let (x, y) = (bundle.checked_rem(self.width)?, bundle.checked_div(self.width)?);
        if y >= self.height {
            return None;
        }
        let block = (y / self.tile * self.tiles_x() + x / self.tile) as usize;
        let [left, top, width, _] = self.rect(block);
        Some((block, (y - top) * width + x - left))
    }

    /// A block and those around it.
    pub fn around(&self, block_idx: usize) -> impl Iterator<Item = usize> {
        let (across, down) = (self.tiles_x() as usize, self.tiles_y() as usize);
        let (x, y) = (block_idx % across, block_idx / across);
        let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
        near(y, down).flat_map(move |y| near(x, across).map(move |x| y * across + x))
    }

    /// The bundles of a block, row by row; appended to `out` after clearing it.
    pub fn bundles(&self, block_idx: usize, out: &mut Vec<u32>) {
        let [x0, y0, w, h] = self.rect(block_idx);
        out.clear();
        out.extend((y0..y0 + h).flat_map(|y| (x0..x0 + w).map(move |x| y * self.width + x)));
    }
}

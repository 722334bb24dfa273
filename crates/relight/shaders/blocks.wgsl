// What project, gather and expand have in common; it stands before each of them.

struct Block {
    rank: u32,
    n_pixels: u32,
    x: u32,
    y: u32,
    width: u32,
    left: u32,
    right: u32,
    z: u32,
    sparse: u32,
    n_sparse: u32,
}

struct Group {
    n_cols: u32,
    frame_width: u32,
    n_segments: u32,
    // What expand does: 0 adds, 1 sets, 2 sets where z moved.
    mode: u32,
    // Nit by which blocks may miss the exact answer; below 0 all of them are brought up to date.
    unseen: f32,
}

@group(0) @binding(0) var<uniform> group: Group;

@group(1) @binding(0) var<storage, read> blocks: array<Block>;

const THREADS: u32 = 64u;
// Workgroups of a row of the grid.
const ROW: u32 = 32768u;

// What project, gather and expand have in common; it stands before each of them.

struct Block {
    rank: u32,
    n_pixels: u32,
    x: u32,
    y: u32,
    width: u32,
    left: u32,
    z: u32,
    sparse: u32,
    n_sparse: u32,
    // Components of the block, those included that fill the last word.
    n_components: u32,
    // Components of the left factor that are halves; the rest are bytes.
    left_halves: u32,
    // Its number among the tiles of the frame.
    tile: u32,
}

struct Group {
    n_cols: u32,
    frame_width: u32,
    n_segments: u32,
    // What expand does: 0 adds, 1 sets on top of the settled groups, 2 sets alone.
    mode: u32,
    // Nit by which tiles may miss the exact answer; below 0 all of them are brought up to date.
    unseen: f32,
}

@group(0) @binding(0) var<uniform> group: Group;

const THREADS: u32 = 64u;
// Workgroups of a row of the grid.
const ROW: u32 = 32768u;
// Threads that share a block in gather.
const PER_BLOCK: u32 = 8u;

// Four bytes of a word, the lowest first: in the lower bits of halves from 1024 on, which is less work than a conversion of each.
fn signed_bytes(word: u32) -> vec4<f32> {
    let even = unpack2x16float((word & 0x00ff00ffu) ^ 0x64806480u);
    let odd = unpack2x16float(((word >> 8u) & 0x00ff00ffu) ^ 0x64806480u);
    return vec4<f32>(even.x, odd.x, even.y, odd.y) - 1152.0;
}

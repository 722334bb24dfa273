// What project, gather, settle and expand have in common; it stands before each of them.

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
    // Components of z, those included that fill the last word.
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
// Threads that share a block in gather and settle.
const PER_BLOCK: u32 = 8u;

// Four bytes of a word, the lowest first.
fn signed_bytes(word: u32) -> vec4<f32> {
    return vec4<f32>(vec4<i32>(vec4<u32>(word) << vec4<u32>(24u, 16u, 8u, 0u)) >> vec4<u32>(24u));
}

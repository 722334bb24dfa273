// Project: z = scale · right · x, one workgroup per component of a block. Twin of src/cpu/project.rs.

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
    unused_0: u32,
    unused_1: u32,
}

@group(0) @binding(0) var<uniform> group: Group;
// One per column, padded with zeros to an even number.
@group(0) @binding(1) var<storage, read> coefficients: array<vec4<f32>>;

@group(1) @binding(0) var<storage, read> blocks: array<Block>;
// Pairs of f16, row by row; every row starts at a word.
@group(1) @binding(1) var<storage, read> right: array<u32>;
// One per component; the padding component of an odd rank has 0.
@group(1) @binding(2) var<storage, read> scale: array<f32>;
@group(1) @binding(3) var<storage, read_write> z: array<vec4<f32>>;

const THREADS: u32 = 64u;
var<workgroup> partial: array<vec3<f32>, THREADS>;

@compute @workgroup_size(THREADS)
fn project(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let block = blocks[id.y];
    let component = id.x;
    let n_pairs = (group.n_cols + 1u) / 2u;

    // Each thread sums every 64th pair of columns.
    var sum = vec3<f32>(0.0);
    if component < block.rank {
        let row = block.right + component * n_pairs;
        for (var k = thread; k < n_pairs; k += THREADS) {
            let pair = unpack2x16float(right[row + k]);
            sum += pair.x * coefficients[2u * k].xyz + pair.y * coefficients[2u * k + 1u].xyz;
        }
    }
    partial[thread] = sum;
    workgroupBarrier();

    // A tree gives the same order on every run.
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        if thread < half {
            partial[thread] += partial[thread + half];
        }
        workgroupBarrier();
    }
    if thread == 0u && component < 2u * ((block.rank + 1u) / 2u) {
        z[block.z + component] = vec4<f32>(scale[block.z + component] * partial[0], 0.0);
    }
}

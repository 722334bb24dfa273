// Expand: left · z + sparse · x, one thread per pixel of a block, added to the radiance or to that of the other groups. Twin
// of src/cpu/expand.rs.

struct SparseTerm {
    // Column, and the channel in the upper two bits.
    col_channel: u32,
    value: f32,
}

@group(0) @binding(1) var<storage, read> coefficients: array<vec4<f32>>;
// The frame, row by row; the fourth component stays 0.
@group(0) @binding(2) var<storage, read_write> radiance: array<vec4<f32>>;
// The groups that do not move, summed.
@group(0) @binding(3) var<storage, read> settled: array<vec4<f32>>;

// Pairs of f16 (two components of one row), then fours of bytes. Of a block: pair by pair and four by four, channel by
// channel, pixel by pixel, so that neighboring threads read neighboring words.
@group(1) @binding(1) var<storage, read> left: array<u32>;
// The fourth component says whether those of the block moved.
@group(1) @binding(2) var<storage, read> z: array<vec4<f32>>;
// Of a block with sparse terms: n_pixels + 1 positions in `sparse_terms`.
@group(1) @binding(3) var<storage, read> sparse_starts: array<u32>;
@group(1) @binding(4) var<storage, read> sparse_terms: array<SparseTerm>;

const ADD: u32 = 0u;
const SET_MOVED: u32 = 2u;

@compute @workgroup_size(THREADS)
fn expand(
    @builtin(workgroup_id) id: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = blocks[id.y];
    if group.mode == SET_MOVED && block.n_sparse == 0u && (block.rank == 0u || z[block.z].w == 0.0) {
        return;
    }
    for (var pixel = id.x * THREADS + thread; pixel < block.n_pixels; pixel += n_groups.x * THREADS) {
        expand_pixel(block, pixel);
    }
}

fn expand_pixel(block: Block, pixel: u32) {
    var sum = vec3<f32>(0.0);
    var word = block.left + pixel;
    for (var k = 0u; k < block.left_halves; k += 2u) {
        let r = unpack2x16float(left[word]);
        let g = unpack2x16float(left[word + block.n_pixels]);
        let b = unpack2x16float(left[word + 2u * block.n_pixels]);
        let z_0 = z[block.z + k].xyz;
        let z_1 = z[block.z + k + 1u].xyz;
        sum += vec3<f32>(r.x, g.x, b.x) * z_0 + vec3<f32>(r.y, g.y, b.y) * z_1;
        word += 3u * block.n_pixels;
    }
    // Where halves are followed by bytes they are a whole number of pairs.
    for (var k = block.left_halves; k < block.rank; k += 4u) {
        let r = signed_bytes(left[word]);
        let g = signed_bytes(left[word + block.n_pixels]);
        let b = signed_bytes(left[word + 2u * block.n_pixels]);
        for (var i = 0u; i < 4u; i += 1u) {
            sum += vec3<f32>(r[i], g[i], b[i]) * z[block.z + k + i].xyz;
        }
        word += 3u * block.n_pixels;
    }

    if block.n_sparse > 0u {
        let last = sparse_starts[block.sparse + pixel + 1u];
        for (var i = sparse_starts[block.sparse + pixel]; i < last; i += 1u) {
            let term = sparse_terms[i];
            let channel = term.col_channel >> 30u;
            sum[channel] += term.value * coefficients[term.col_channel & 0x3fffffffu][channel];
        }
    }

    let x = block.x + pixel % block.width;
    let y = block.y + pixel / block.width;
    let at = y * group.frame_width + x;
    if group.mode == ADD {
        radiance[at] += vec4<f32>(sum, 0.0);
    } else {
        radiance[at] = settled[at] + vec4<f32>(sum, 0.0);
    }
}

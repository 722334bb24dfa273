// Expand: left · z + sparse · x in tiles that would miss more than is overlooked, four pixels of a block per thread, so that what they
// meet is read once for all four; added to the radiance, or in its place, or in that of the settled groups. Twin of src/cpu/expand.rs.

@group(0) @binding(1) var<storage, read> coefficients: array<vec4<f32>>;
// The frame, row by row; the fourth component stays 0.
@group(0) @binding(2) var<storage, read_write> radiance: array<vec4<f32>>;
// The groups that do not move, summed.
@group(0) @binding(3) var<storage, read> settled: array<vec4<f32>>;
// One per tile of the frame.
@group(0) @binding(4) var<storage, read> behind: array<f32>;

// Every tile, those without content, too.
@group(1) @binding(0) var<storage, read> blocks: array<Block>;
// Pairs of f16 (two components of one row), then fours of bytes. Of a block: pair by pair and four by four, channel by
// channel, pixel by pixel, so that neighboring threads read neighboring words.
@group(1) @binding(1) var<storage, read> left: array<u32>;
// As in gather.wgsl; the fresh z takes the place of the other.
@group(1) @binding(2) var<storage, read_write> partials: array<vec4<f32>>;
// Of a block with sparse terms: where the terms of each pixel start, and where the last ends; then the terms: column, with the
// channel in the upper two bits, and value.
@group(1) @binding(3) var<storage, read> sparse: array<u32>;

const ADD: u32 = 0u;
const SET: u32 = 1u;
// Pixels of a thread.
const PIXELS: u32 = 4u;

@compute @workgroup_size(THREADS)
fn expand(
    @builtin(workgroup_id) id: vec3<u32>,
    @builtin(num_workgroups) n_groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = blocks[id.y];
    if group.unseen >= 0.0 && behind[block.tile] <= group.unseen {
        return;
    }
    if group.mode == ADD && block.rank == 0u && block.n_sparse == 0u {
        return;
    }
    let stride = arrayLength(&partials) / (group.n_segments + 2u);
    let z = group.n_segments * stride + block.z;
    if id.x == 0u {
        for (var component = thread; component < block.n_components; component += THREADS) {
            partials[z + stride + component] = partials[z + component];
        }
    }
    let run = PIXELS * THREADS;
    for (var first = id.x * run; first < block.n_pixels; first += n_groups.x * run) {
        if first + run <= block.n_pixels {
            expand_four(block, z, first + thread);
        } else {
            for (var pixel = first + thread; pixel < block.n_pixels; pixel += THREADS) {
                expand_one(block, z, pixel);
            }
        }
    }
}

// The pixels that lie as many apart as there are threads.
fn expand_four(block: Block, z: u32, pixel: u32) {
    let n = block.n_pixels;
    var a = vec3<f32>(0.0);
    var b = vec3<f32>(0.0);
    var c = vec3<f32>(0.0);
    var d = vec3<f32>(0.0);
    var word = block.left + pixel;
    for (var k = 0u; k < block.left_halves; k += 2u) {
        let z_0 = partials[z + k].xyz;
        let z_1 = partials[z + k + 1u].xyz;
        a += of_pair(word, n, z_0, z_1);
        b += of_pair(word + THREADS, n, z_0, z_1);
        c += of_pair(word + 2u * THREADS, n, z_0, z_1);
        d += of_pair(word + 3u * THREADS, n, z_0, z_1);
        word += 3u * n;
    }
    // Where halves are followed by bytes they are a whole number of pairs.
    for (var k = block.left_halves; k < block.rank; k += 4u) {
        let z_4 = mat4x3<f32>(partials[z + k].xyz, partials[z + k + 1u].xyz, partials[z + k + 2u].xyz, partials[z + k + 3u].xyz);
        a += of_four(word, n, z_4);
        b += of_four(word + THREADS, n, z_4);
        c += of_four(word + 2u * THREADS, n, z_4);
        d += of_four(word + 3u * THREADS, n, z_4);
        word += 3u * n;
    }
    if block.n_sparse > 0u {
        a += of_sparse(block, pixel);
        b += of_sparse(block, pixel + THREADS);
        c += of_sparse(block, pixel + 2u * THREADS);
        d += of_sparse(block, pixel + 3u * THREADS);
    }
    var at = vec4<u32>(place(block, pixel));
    if THREADS % block.width == 0u {
        at += THREADS / block.width * group.frame_width * vec4<u32>(0u, 1u, 2u, 3u);
    } else {
        at.y = place(block, pixel + THREADS);
        at.z = place(block, pixel + 2u * THREADS);
        at.w = place(block, pixel + 3u * THREADS);
    }
    put(at.x, a);
    put(at.y, b);
    put(at.z, c);
    put(at.w, d);
}

fn expand_one(block: Block, z: u32, pixel: u32) {
    let n = block.n_pixels;
    var sum = vec3<f32>(0.0);
    var word = block.left + pixel;
    for (var k = 0u; k < block.left_halves; k += 2u) {
        sum += of_pair(word, n, partials[z + k].xyz, partials[z + k + 1u].xyz);
        word += 3u * n;
    }
    for (var k = block.left_halves; k < block.rank; k += 4u) {
        let z_4 = mat4x3<f32>(partials[z + k].xyz, partials[z + k + 1u].xyz, partials[z + k + 2u].xyz, partials[z + k + 3u].xyz);
        sum += of_four(word, n, z_4);
        word += 3u * n;
    }
    if block.n_sparse > 0u {
        sum += of_sparse(block, pixel);
    }
    put(place(block, pixel), sum);
}

// Two components of a pixel.
fn of_pair(word: u32, n_pixels: u32, z_0: vec3<f32>, z_1: vec3<f32>) -> vec3<f32> {
    let r = unpack2x16float(left[word]);
    let g = unpack2x16float(left[word + n_pixels]);
    let b = unpack2x16float(left[word + 2u * n_pixels]);
    return vec3<f32>(r.x, g.x, b.x) * z_0 + vec3<f32>(r.y, g.y, b.y) * z_1;
}

// Four components of a pixel.
fn of_four(word: u32, n_pixels: u32, z_4: mat4x3<f32>) -> vec3<f32> {
    let r = signed_bytes(left[word]);
    let g = signed_bytes(left[word + n_pixels]);
    let b = signed_bytes(left[word + 2u * n_pixels]);
    let low = vec3<f32>(r.x, g.x, b.x) * z_4[0] + vec3<f32>(r.y, g.y, b.y) * z_4[1];
    return low + vec3<f32>(r.z, g.z, b.z) * z_4[2] + vec3<f32>(r.w, g.w, b.w) * z_4[3];
}

// The sparse terms of a pixel.
fn of_sparse(block: Block, pixel: u32) -> vec3<f32> {
    var sum = vec3<f32>(0.0);
    let last = sparse[block.sparse + pixel + 1u];
    for (var i = sparse[block.sparse + pixel]; i < last; i += 2u) {
        let col_channel = sparse[i];
        let channel = col_channel >> 30u;
        sum[channel] += bitcast<f32>(sparse[i + 1u]) * coefficients[col_channel & 0x3fffffffu][channel];
    }
    return sum;
}

// Where a pixel of a block is in the frame.
fn place(block: Block, pixel: u32) -> u32 {
    return (block.y + pixel / block.width) * group.frame_width + block.x + pixel % block.width;
}

fn put(at: u32, sum: vec3<f32>) {
    var below = vec4<f32>(0.0);
    if group.mode == ADD {
        below = radiance[at];
    } else if group.mode == SET {
        below = settled[at];
    }
    radiance[at] = below + vec4<f32>(sum, 0.0);
}

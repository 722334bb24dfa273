// Project: right · x over one segment of columns, one workgroup per component and segment, so that no block waits for one of
// higher rank. Twin of src/cpu/project.rs; gather.wgsl sums the segments.

// One per column, padded with zeros to an even number.
@group(0) @binding(1) var<storage, read> coefficients: array<vec4<f32>>;
// Segments whose coefficients changed.
@group(0) @binding(2) var<storage, read> segments: array<u32>;

// Pairs of f16, row by row, then fours of bytes, row by row; every row starts at a word.
@group(1) @binding(1) var<storage, read> right: array<u32>;
// Of a block segment by segment, component by component.
@group(1) @binding(2) var<storage, read_write> partials: array<vec4<f32>>;

// The block of each component.
@group(1) @binding(3) var<storage, read> owners: array<u32>;

var<workgroup> partial: array<vec3<f32>, THREADS>;

@compute @workgroup_size(THREADS)
fn project(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = id.y * ROW + id.x;
    if at >= arrayLength(&owners) {
        return;
    }
    let block = blocks[owners[at]];
    // Beyond the last component there is none of any block.
    let component = at - block.z;
    let segment = segments[id.z];
    let n_pairs = (group.n_cols + 1u) / 2u;

    // A segment is as many pairs of columns as there are threads.
    let k = segment * THREADS + thread;
    var sum = vec3<f32>(0.0);
    if component < block.rank && k < n_pairs {
        let pair = right_pair(block, component, k, n_pairs);
        sum = pair.x * coefficients[2u * k].xyz + pair.y * coefficients[2u * k + 1u].xyz;
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
    if thread == 0u && component < block.n_components {
        partials[block.z * group.n_segments + segment * block.n_components + component] = vec4<f32>(partial[0], 0.0);
    }
}

// Two columns of a component.
fn right_pair(block: Block, component: u32, k: u32, n_pairs: u32) -> vec2<f32> {
    if component < block.right_halves {
        return unpack2x16float(right[block.right + component * n_pairs + k]);
    }
    let first = block.right + block.right_halves * n_pairs;
    // Two threads read one word.
    let four = signed_bytes(right[first + (component - block.right_halves) * ((n_pairs + 1u) / 2u) + k / 2u]);
    return select(four.xy, four.zw, k % 2u == 1u);
}

// Project: right · x over one segment of columns, one thread per component, whichever block it is of. A thread sums its
// component from front to back, so that no thread waits for another, and threads side by side read what lies side by side. Twin of
// src/cpu/project.rs; gather.wgsl sums the segments.

// One per column, padded with zeros to a multiple of 16. The fourth component says whether it changed.
@group(0) @binding(1) var<storage, read> coefficients: array<vec4<f32>>;
// Segments whose coefficients changed.
@group(0) @binding(2) var<storage, read> segments: array<u32>;

// Of components in bands of as many as there are threads, the last of each kind shorter: eights of f16, or after all of those
// sixteens of bytes, eight after eight, component after component.
@group(1) @binding(0) var<storage, read> right: array<vec4<u32>>;
// Segment by segment as long as z.
@group(1) @binding(1) var<storage, read_write> partials: array<vec4<f32>>;
// How many components are halves, how many bytes; then the place in z of each.
@group(1) @binding(2) var<storage, read> components_of: array<u32>;

// Columns of a segment.
const SEGMENT: u32 = 128u;

@compute @workgroup_size(THREADS)
fn project(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let band = id.y * ROW + id.x;
    let n_halves = components_of[0];
    let n_bytes = components_of[1];
    let n_half_bands = (n_halves + THREADS - 1u) / THREADS;
    let segment = segments[id.z];

    var at = band * THREADS + thread;
    var sum = vec3<f32>(0.0);
    if band < n_half_bands {
        if at >= n_halves {
            return;
        }
        sum = of_halves(segment, band * THREADS, thread, n_halves);
    } else {
        let first = (band - n_half_bands) * THREADS;
        at = first + thread;
        if at >= n_bytes {
            return;
        }
        sum = of_bytes(segment, first, thread, n_halves, n_bytes);
        at += n_halves;
    }
    let stride = arrayLength(&partials) / (group.n_segments + 1u);
    partials[segment * stride + components_of[2u + at]] = vec4<f32>(sum, 0.0);
}

fn of_halves(segment: u32, first: u32, thread: u32, n_halves: u32) -> vec3<f32> {
    let n_eights = (group.n_cols + 7u) / 8u;
    let width = min(THREADS, n_halves - first);
    let begin = segment * (SEGMENT / 8u);
    let end = min(begin + SEGMENT / 8u, n_eights);
    var at = first * n_eights + begin * width + thread;
    var sum = vec3<f32>(0.0);
    for (var eight = begin; eight < end; eight += 1u) {
        let words = right[at];
        let col = 8u * eight;
        sum += of_pair(unpack2x16float(words.x), col) + of_pair(unpack2x16float(words.y), col + 2u);
        sum += of_pair(unpack2x16float(words.z), col + 4u) + of_pair(unpack2x16float(words.w), col + 6u);
        at += width;
    }
    return sum;
}

fn of_bytes(segment: u32, first: u32, thread: u32, n_halves: u32, n_bytes: u32) -> vec3<f32> {
    let n_sixteens = (group.n_cols + 15u) / 16u;
    let width = min(THREADS, n_bytes - first);
    let begin = segment * (SEGMENT / 16u);
    let end = min(begin + SEGMENT / 16u, n_sixteens);
    var at = n_halves * ((group.n_cols + 7u) / 8u) + first * n_sixteens + begin * width + thread;
    var sum = vec3<f32>(0.0);
    for (var sixteen = begin; sixteen < end; sixteen += 1u) {
        let words = right[at];
        let col = 16u * sixteen;
        sum += of_four(signed_bytes(words.x), col) + of_four(signed_bytes(words.y), col + 4u);
        sum += of_four(signed_bytes(words.z), col + 8u) + of_four(signed_bytes(words.w), col + 12u);
        at += width;
    }
    return sum;
}

// All threads meet the same coefficients at the same time.
fn of_pair(entries: vec2<f32>, col: u32) -> vec3<f32> {
    return entries.x * coefficients[col].xyz + entries.y * coefficients[col + 1u].xyz;
}

fn of_four(entries: vec4<f32>, col: u32) -> vec3<f32> {
    return of_pair(entries.xy, col) + of_pair(entries.zw, col + 2u);
}

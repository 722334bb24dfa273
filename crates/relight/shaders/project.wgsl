// Project: right · x over one segment of columns, whichever blocks the components are of. The threads of a part sum some of the
// columns, each of a few components, for which it reads x once; threads side by side read what lies side by side. Twin of
// src/cpu/project.rs; gather.wgsl sums the segments.

// One per column, padded with zeros to a multiple of 16. The fourth component says whether it changed.
@group(0) @binding(1) var<storage, read> coefficients: array<vec4<f32>>;
// Segments whose coefficients changed.
@group(0) @binding(2) var<storage, read> segments: array<u32>;

// Of components in bands of as many as a workgroup takes, the last of each kind shorter: eights of f16, or after all of those
// sixteens of bytes, eight after eight, component after component.
@group(1) @binding(0) var<storage, read> right: array<vec4<u32>>;
// Segment by segment one per component, as in gather.wgsl.
@group(1) @binding(1) var<storage, read_write> partials: array<vec4<f32>>;
// How many components are halves, how many bytes; then the place in a segment of each.
@group(1) @binding(2) var<storage, read> components_of: array<u32>;

// Columns of a segment.
const SEGMENT: u32 = 128u;
// Components of a thread, as many apart as there are threads.
const COMPONENTS: u32 = 4u;
const BAND: u32 = COMPONENTS * THREADS;
// Parts of a segment, of as many threads each.
const PARTS: u32 = 2u;

// Sums of all parts but the first: channel by channel of component after component, thread by thread.
var<workgroup> shares: array<f32, 3u * COMPONENTS * (PARTS - 1u) * THREADS>;

@compute @workgroup_size(PARTS * THREADS)
fn project(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let nth = id.y * ROW + id.x;
    let n_halves = components_of[0];
    let n_bytes = components_of[1];
    let n_half_bands = (n_halves + BAND - 1u) / BAND;
    let n_eights = (group.n_cols + 7u) / 8u;
    let segment = segments[id.z];
    let part = local / THREADS;
    let thread = local % THREADS;
    let is_half = nth < n_half_bands;
    let first = select(nth - n_half_bands, nth, is_half) * BAND;
    // None in a grid that is longer than there are bands.
    let width = min(BAND, max(select(n_bytes, n_halves, is_half), first) - first);
    var sums = mat4x3<f32>();
    if width > 0u {
        if is_half {
            sums = of_halves(segment, part, first * n_eights, width, thread);
        } else {
            let n_sixteens = (group.n_cols + 15u) / 16u;
            sums = of_bytes(segment, part, n_halves * n_eights + first * n_sixteens, width, thread);
        }
    }
    if part > 0u {
        share(sums, local - THREADS);
    }
    workgroupBarrier();
    if part > 0u {
        return;
    }
    for (var other = 0u; other < PARTS - 1u; other += 1u) {
        sums += shared_sums(other * THREADS + thread);
    }
    let place = 2u + first + select(n_halves, 0u, is_half);
    put(segment, place, width, thread, sums);
}

fn share(sums: mat4x3<f32>, at: u32) {
    let n = (PARTS - 1u) * THREADS;
    for (var channel = 0u; channel < 3u; channel += 1u) {
        shares[channel * n + at] = sums[0][channel];
        shares[(3u + channel) * n + at] = sums[1][channel];
        shares[(6u + channel) * n + at] = sums[2][channel];
        shares[(9u + channel) * n + at] = sums[3][channel];
    }
}

fn shared_sums(at: u32) -> mat4x3<f32> {
    return mat4x3<f32>(shared_sum(at, 0u), shared_sum(at, 1u), shared_sum(at, 2u), shared_sum(at, 3u));
}

fn shared_sum(at: u32, component: u32) -> vec3<f32> {
    let n = (PARTS - 1u) * THREADS;
    let first = 3u * component * n + at;
    return vec3<f32>(shares[first], shares[first + n], shares[first + 2u * n]);
}

// Where the components of a thread are within their band; those that are none are read like the last, and not written.
fn places(thread: u32, width: u32) -> vec4<u32> {
    return min(vec4<u32>(thread) + THREADS * vec4<u32>(0u, 1u, 2u, 3u), vec4<u32>(width - 1u));
}

fn of_halves(segment: u32, part: u32, words: u32, width: u32, thread: u32) -> mat4x3<f32> {
    let n = SEGMENT / 8u / PARTS;
    let begin = segment * (SEGMENT / 8u) + part * n;
    let end = min(begin + n, (group.n_cols + 7u) / 8u);
    var at = vec4<u32>(words + begin * width) + places(thread, width);
    var sums = mat4x3<f32>();
    for (var eight = begin; eight < end; eight += 1u) {
        let a = right[at.x];
        let b = right[at.y];
        let c = right[at.z];
        let d = right[at.w];
        let col = 8u * eight;
        sums += of_pairs(vec4<u32>(a.x, b.x, c.x, d.x), col);
        sums += of_pairs(vec4<u32>(a.y, b.y, c.y, d.y), col + 2u);
        sums += of_pairs(vec4<u32>(a.z, b.z, c.z, d.z), col + 4u);
        sums += of_pairs(vec4<u32>(a.w, b.w, c.w, d.w), col + 6u);
        at += vec4<u32>(width);
    }
    return sums;
}

fn of_bytes(segment: u32, part: u32, words: u32, width: u32, thread: u32) -> mat4x3<f32> {
    let n = SEGMENT / 16u / PARTS;
    let begin = segment * (SEGMENT / 16u) + part * n;
    let end = min(begin + n, (group.n_cols + 15u) / 16u);
    var at = vec4<u32>(words + begin * width) + places(thread, width);
    var sums = mat4x3<f32>();
    for (var sixteen = begin; sixteen < end; sixteen += 1u) {
        let a = right[at.x];
        let b = right[at.y];
        let c = right[at.z];
        let d = right[at.w];
        let col = 16u * sixteen;
        sums += of_fours(vec4<u32>(a.x, b.x, c.x, d.x), col);
        sums += of_fours(vec4<u32>(a.y, b.y, c.y, d.y), col + 4u);
        sums += of_fours(vec4<u32>(a.z, b.z, c.z, d.z), col + 8u);
        sums += of_fours(vec4<u32>(a.w, b.w, c.w, d.w), col + 12u);
        at += vec4<u32>(width);
    }
    return sums;
}

// Two columns of four components. All threads meet the same coefficients at the same time.
fn of_pairs(words: vec4<u32>, col: u32) -> mat4x3<f32> {
    let x_0 = coefficients[col].xyz;
    let x_1 = coefficients[col + 1u].xyz;
    return mat4x3<f32>(
        of_pair(unpack2x16float(words.x), x_0, x_1),
        of_pair(unpack2x16float(words.y), x_0, x_1),
        of_pair(unpack2x16float(words.z), x_0, x_1),
        of_pair(unpack2x16float(words.w), x_0, x_1),
    );
}

fn of_pair(entries: vec2<f32>, x_0: vec3<f32>, x_1: vec3<f32>) -> vec3<f32> {
    return entries.x * x_0 + entries.y * x_1;
}

// Four columns of four components.
fn of_fours(words: vec4<u32>, col: u32) -> mat4x3<f32> {
    let x = mat4x3<f32>(
        coefficients[col].xyz,
        coefficients[col + 1u].xyz,
        coefficients[col + 2u].xyz,
        coefficients[col + 3u].xyz,
    );
    return mat4x3<f32>(
        x * signed_bytes(words.x),
        x * signed_bytes(words.y),
        x * signed_bytes(words.z),
        x * signed_bytes(words.w),
    );
}

// From a place in `components_of` on.
fn put(segment: u32, first: u32, width: u32, thread: u32, sums: mat4x3<f32>) {
    let stride = arrayLength(&partials) / (group.n_segments + 2u);
    let sums_of = array<vec3<f32>, 4>(sums[0], sums[1], sums[2], sums[3]);
    for (var i = 0u; i < COMPONENTS; i += 1u) {
        let at = thread + i * THREADS;
        if at < width {
            partials[segment * stride + components_of[first + at]] = vec4<f32>(sums_of[i], 0.0);
        }
    }
}

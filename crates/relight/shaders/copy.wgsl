// Copy: what a device reads and writes at most, to hold the other stages against.

@group(0) @binding(0) var<storage, read> source: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> copied: array<vec4<f32>>;

const THREADS: u32 = 256u;
// Workgroups of a row of the grid.
const ROW: u32 = 32768u;

// Four elements of a thread, as many apart as there are threads, all of them read before any is written.
@compute @workgroup_size(THREADS)
fn copy(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = 4u * (id.y * ROW + id.x) * THREADS + thread;
    let last = arrayLength(&copied) - 1u;
    let places = min(vec4<u32>(at) + THREADS * vec4<u32>(0u, 1u, 2u, 3u), vec4<u32>(last));
    let a = source[places.x];
    let b = source[places.y];
    let c = source[places.z];
    let d = source[places.w];
    copied[places.x] = a;
    copied[places.y] = b;
    copied[places.z] = c;
    copied[places.w] = d;
}

// Copy: what a device reads and writes at most, to hold the other stages against.

@group(0) @binding(0) var<storage, read> source: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> copied: array<vec4<f32>>;

const THREADS: u32 = 64u;
// Workgroups of a row of the grid.
const ROW: u32 = 32768u;

@compute @workgroup_size(THREADS)
fn copy(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = (id.y * ROW + id.x) * THREADS + thread;
    if at < arrayLength(&copied) {
        copied[at] = source[at];
    }
}

// Gather: z = scale · sum over segments, one thread per component of a block. Twin of src/cpu/project.rs.

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
    n_segments: u32,
    // What expand does: 0 adds, 1 sets, 2 sets where z moved.
    mode: u32,
}

@group(0) @binding(0) var<uniform> group: Group;

@group(1) @binding(0) var<storage, read> blocks: array<Block>;
// One per component; the padding component of an odd rank has 0.
@group(1) @binding(1) var<storage, read> scale: array<f32>;
@group(1) @binding(2) var<storage, read> partials: array<vec4<f32>>;
// The fourth component says whether the others moved.
@group(1) @binding(3) var<storage, read_write> z: array<vec4<f32>>;

const THREADS: u32 = 64u;

@compute @workgroup_size(THREADS)
fn gather(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let block = blocks[id.y];
    let component = id.x * THREADS + thread;
    let n_components = 2u * ((block.rank + 1u) / 2u);
    if component >= n_components {
        return;
    }

    // In the order of the segments, whatever was projected just now.
    var sum = vec3<f32>(0.0);
    let first = block.z * group.n_segments + component;
    for (var segment = 0u; segment < group.n_segments; segment += 1u) {
        sum += partials[first + segment * n_components].xyz;
    }
    let at = block.z + component;
    let fresh = scale[at] * sum;
    z[at] = vec4<f32>(fresh, select(0.0, 1.0, any(fresh != z[at].xyz)));
}

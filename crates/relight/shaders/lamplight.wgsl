// Direct light of one lamp at what each pixel sees: for each of its points one point of the lamp, and one ray between them.
//
// A pixel that has something the device does not know (clear panes and alpha in the way, solids, coats of several layers,
// a body close by) is left to the CPU as a whole, which finds it with the same numbers: w of its light is 1.

struct Lamp {
    // 0 point, 1 spot, 2 parallel light, 3 rectangle, 4 disk, 5 sphere.
    kind: u32,
    width: u32,
    height: u32,
    // Nodes before the one where clear panes and alpha begin; NONE without them.
    sheer: u32,
    position: vec3f,
    // Of a body, m².
    area: f32,
    // Where a lamp aims; the normal of a flat body.
    axis: vec3f,
    // Of a spot: one minus the cosine of its outer angle.
    rim: f32,
    // From the middle of a flat body to the middles of two sides.
    half_x: vec3f,
    // Of a spot: one over how much of that its rise takes.
    per_cos: f32,
    half_y: vec3f,
    // Squared distance from the middle of a flat body within which the CPU decides, m²; of a sphere the squared radius.
    near: f32,
    // Candela, lux or nit.
    emission: vec3f,
    // Beyond all surfaces, m.
    far: f32,
}

@group(0) @binding(0) var<uniform> lamp: Lamp;
// Eight boxes: lower x, y, z, upper x, y, z, then what is in them. 14 rows of four numbers.
@group(0) @binding(1) var<storage, read> nodes: array<vec4u>;
// Four triangles: corner × axis, then their names. 10 rows of four numbers.
@group(0) @binding(2) var<storage, read> blocks: array<vec4u>;
// 4 rows of four numbers each.
@group(0) @binding(3) var<storage, read> points: array<vec4u>;
// Where the points of each pixel begin, and the number of points.
@group(0) @binding(4) var<storage, read> starts: array<u32>;
// Albedo of coats per f0 and f90, by roughness and by cosine; then the mean of (1 − cos)⁵ by cosine; then factors of facets that
// scatter light repeatedly, by roughness and by cosine.
@group(0) @binding(5) var<storage, read> coats: array<f32>;
// Random offset of the points on the lamp, by tile.
@group(0) @binding(6) var<storage, read> shifts: array<vec2f>;
@group(0) @binding(7) var<storage, read_write> lit: array<vec4f>;

const NONE: u32 = 0xffffffffu;
const IS_BLOCK: u32 = 0x80000000u;
const NODE_ROWS: u32 = 14u;
const BLOCK_ROWS: u32 = 10u;
const POINT_ROWS: u32 = 4u;
const STACK: u32 = 64u;
const TILE: u32 = 16u;
// Bit of a point that is the CPU's.
const LEFT: u32 = 1u;
// Rays end just before the lamp.
const END: f32 = 0.9999;
// Rounding never loses a triangle in its box.
const FAR_SLACK: f32 = 1.00000095;
const FREE: u32 = 0u;
const BLOCKED: u32 = 1u;
const UNKNOWN: u32 = 2u;
const PI: f32 = 3.14159265;
const MIRROR_ALPHA: f32 = 1e-3;
const N_COS: u32 = 32u;
const N_ROUGHNESS: u32 = 24u;
// A lamp without size has this one next to it, m².
const POINT_SQUARE: f32 = 1e-4;

// What a lamp sends to a point: towards it, where it is, and how much.
struct Sent {
    wi: vec3f,
    factor: f32,
    toward: vec3f,
    // Whether it sends anything; 2 where the CPU has to say.
    state: u32,
}

fn unit(packed: u32) -> vec3f {
    let p = unpack2x16snorm(packed);
    let z = 1.0 - abs(p.x) - abs(p.y);
    let folded = (vec2f(1.0) - abs(p.yx)) * select(vec2f(-1.0), vec2f(1.0), p >= vec2f(0.0));
    return normalize(vec3f(select(p, folded, z < 0.0), z));
}

// Points of the unit square that are far apart.
fn lattice(nth: u32) -> vec2f {
    let at = vec2u(nth * 0xC13FA9A9u, nth * 0x91E10DA5u) + vec2u(0x80000000u);
    return vec2f(at >> vec2u(8u)) / 16777216.0;
}

fn hammersley(nth: u32) -> vec2f {
    return vec2f(f32(nth) / 16.0, f32(reverseBits(nth) >> 28u) / 16.0);
}

// The unit square onto the unit disk, areas and neighbors kept.
fn concentric(u: vec2f) -> vec2f {
    let p = 2.0 * u - 1.0;
    if p.x == 0.0 && p.y == 0.0 {
        return p;
    }
    let is_wide = abs(p.x) > abs(p.y);
    let radius = select(p.y, p.x, is_wide);
    let turn = PI / 4.0 * select(p.x, p.y, is_wide) / radius;
    let angle = select(PI / 2.0 - turn, turn, is_wide);
    return radius * vec2f(cos(angle), sin(angle));
}

fn sent_by_sphere(place: vec3f, u: vec2f) -> Sent {
    let to_center = lamp.position - place;
    let square = dot(to_center, to_center);
    let sin_square = lamp.near / max(square, 1e-30);
    if sin_square >= 1.0 {
        return Sent(vec3f(0.0), 0.0, vec3f(0.0), 0u);
    }
    let ahead = to_center / sqrt(square);
    let one_minus_cos = sin_square / (1.0 + sqrt(1.0 - sin_square));
    let down = one_minus_cos * u.x;
    let radius = sqrt(max(down * (2.0 - down), 0.0));
    // Two directions at right angles to it. [Duff2017]
    let side = select(-1.0, 1.0, ahead.z >= 0.0);
    let a = -1.0 / (side + ahead.z);
    let b = ahead.x * ahead.y * a;
    let x = vec3f(1.0 + side * ahead.x * ahead.x * a, side * b, -side * ahead.x);
    let y = vec3f(b, side + ahead.y * ahead.y * a, -ahead.y);
    let wi = (x * cos(2.0 * PI * u.y) + y * sin(2.0 * PI * u.y)) * radius + ahead * (1.0 - down);
    let along = dot(wi, to_center);
    let depth = sqrt(max(lamp.near - (square - along * along), 0.0));
    return Sent(wi, 2.0 * PI * one_minus_cos, wi * (along - depth), 1u);
}

// One point of the lamp as seen from a place; `own` is the number of a place among those that share `u`.
fn sent(place: vec3f, u: vec2f, own: u32) -> Sent {
    let nothing = Sent(vec3f(0.0), 0.0, vec3f(0.0), 0u);
    if lamp.kind == 2u {
        return Sent(-lamp.axis, 1.0, -lamp.axis * lamp.far, 1u);
    }
    if lamp.kind == 5u {
        return sent_by_sphere(place, fract(u + lattice(1u + own)));
    }
    let from_middle = place - lamp.position;
    var on_lamp = lamp.position;
    if lamp.kind >= 3u {
        if dot(from_middle, from_middle) < lamp.near {
            return Sent(vec3f(0.0), 0.0, vec3f(0.0), UNKNOWN);
        }
        var at = 2.0 * u - 1.0;
        if lamp.kind == 4u {
            at = concentric(u);
        }
        on_lamp = lamp.position + lamp.half_x * at.x + lamp.half_y * at.y;
    }
    let toward = on_lamp - place;
    let square = dot(toward, toward);
    if !(square > 0.0) {
        return nothing;
    }
    let wi = toward / sqrt(square);
    if lamp.kind >= 3u {
        let factor = -dot(wi, lamp.axis) * lamp.area / square;
        return Sent(wi, factor, toward, select(0u, 1u, factor > 0.0));
    }
    var falloff = 1.0;
    if lamp.kind == 1u {
        let aside = wi + lamp.axis;
        let t = clamp((lamp.rim - 0.5 * dot(aside, aside)) * lamp.per_cos, 0.0, 1.0);
        falloff = t * t;
    }
    return Sent(wi, falloff / max(square, POINT_SQUARE), toward, select(0u, 1u, falloff > 0.0));
}

fn fifth(cosine: f32) -> f32 {
    let x = clamp(1.0 - cosine, 0.0, 1.0);
    return x * x * x * x * x;
}

// Share of the diffuse lobe below a coat that energy allows in a direction.
fn allowance(alpha: f32, f0: f32, f90: f32, cosine: f32) -> f32 {
    let at = vec2f(sqrt(alpha) * f32(N_ROUGHNESS - 1u), sqrt(clamp(cosine, 0.0, 1.0)) * f32(N_COS - 1u));
    let low = min(vec2u(at), vec2u(N_ROUGHNESS - 2u, N_COS - 2u));
    let part = at - vec2f(low);
    var per: array<f32, 2>;
    for (var k = 0u; k < 2u; k++) {
        let first = (low.x * N_COS + low.y) * 2u + k;
        let second = first + N_COS * 2u;
        per[k] = mix(mix(coats[first], coats[first + 2u], part.y), mix(coats[second], coats[second + 2u], part.y), part.x);
    }
    let grazing = N_ROUGHNESS * N_COS * 2u + low.y;
    let passed = max(1.0 - f0 - (f90 - f0) * mix(coats[grazing], coats[grazing + 1u], part.y), 1e-6);
    return min(max(1.0 - f0 * per[0] - f90 * per[1], 0.0) / passed, 1.0);
}

// Factor of a direction of facets that scatter light repeatedly.
fn repeated(alpha: f32, cosine: f32) -> f32 {
    let at = vec2f(sqrt(alpha) * f32(N_ROUGHNESS - 1u), sqrt(clamp(cosine, 0.0, 1.0)) * f32(N_COS - 1u));
    let low = min(vec2u(at), vec2u(N_ROUGHNESS - 2u, N_COS - 2u));
    let part = at - vec2f(low);
    let first = (N_ROUGHNESS * 2u + 1u + low.x) * N_COS + low.y;
    let second = first + N_COS;
    return mix(mix(coats[first], coats[first + 1u], part.y), mix(coats[second], coats[second + 1u], part.y), part.x);
}

fn lambda(alpha: f32, cosine: f32) -> f32 {
    let x = alpha * alpha * max(1.0 - cosine * cosine, 0.0) / (cosine * cosine);
    return 0.5 * (sqrt(1.0 + x) - 1.0);
}

// Scattering times cosine towards the viewer of a point, of light from a direction.
fn scattered(first: u32, ng: vec3f, wi: vec3f) -> vec3f {
    let looks = points[first + 2u];
    let color = vec4f(unpack2x16unorm(looks.y), unpack2x16unorm(looks.z));
    let base = color.xyz;
    let metal = color.w;
    let roughness = unpack2x16unorm(looks.w).x;
    let more = points[first + 3u];
    let reflection = vec4f(unpack2x16float(more.x), unpack2x16float(more.y));
    let seen_ns = unit(more.w);
    var wo = unit(looks.x);
    let above = dot(wo, ng);
    if above <= 1e-4 {
        wo = normalize(wo + ng * (1e-4 - above));
    }
    var ns = select(ng, seen_ns, dot(seen_ns, ng) > 0.0);
    if dot(wi, ng) <= 0.0 {
        return vec3f(0.0);
    }
    let lambert = base * (1.0 - metal) / PI;
    if metal <= 0.0 && reflection.w <= 0.0 {
        return lambert * max(dot(wi, ns), 0.0);
    }
    let view = dot(ns, wo);
    if view < 0.01 {
        ns = normalize(ns + wo * (0.01 - view));
    }
    let cos_o = dot(wo, ns);
    let cos_i = dot(wi, ns);
    if cos_i <= 0.0 {
        return vec3f(0.0);
    }
    let wm = normalize(wi + wo);
    let cos_half = dot(wo, wm);
    let grazing = fifth(cos_half);
    let f0 = reflection.xyz;
    let f90 = reflection.w;
    let dielectric = f0 + (vec3f(f90) - f0) * grazing;
    let alpha = roughness * roughness;
    let is_rough = alpha >= MIRROR_ALPHA;
    let most = max(dielectric.x, max(dielectric.y, dielectric.z));
    let allowed = allowance(select(0.0, alpha, is_rough), max(f0.x, max(f0.y, f0.z)), f90, min(cos_i, cos_o));
    var sum = lambert * ((1.0 - most) * allowed * cos_i);
    if is_rough {
        let up = dot(wm, ns);
        let across = cross(wm, ns);
        let spread = dot(across, across) + alpha * alpha * up * up;
        let facets = alpha * alpha / (PI * spread * spread);
        let masking = 1.0 / (1.0 + lambda(alpha, cos_o) + lambda(alpha, cos_i));
        var of_metal = (base + (vec3f(1.0) - base) * grazing) * metal;
        if metal > 0.0 {
            let lossless = vec3f(repeated(alpha, cos_o) * repeated(alpha, cos_i));
            let mean = base + (vec3f(1.0) - base) / 21.0;
            of_metal *= lossless / (lossless - mean * (lossless - vec3f(1.0)));
        }
        let reflected = dielectric * (1.0 - metal) + of_metal;
        sum += reflected * (facets / (4.0 * cos_o) * masking);
    }
    return sum;
}

// What a ray is to triangles: its longest axis and the other two, and its slopes along them.
struct Shear {
    axes: vec3u,
    slopes: vec2f,
    per_length: f32,
}

// Whether a ray meets one of four triangles before its end. [Woop2013]
fn meets(block: u32, origin: vec3f, shear: Shear) -> bool {
    let first = block * BLOCK_ROWS;
    var x: array<vec4f, 3>;
    var y: array<vec4f, 3>;
    var z: array<vec4f, 3>;
    for (var corner = 0u; corner < 3u; corner++) {
        let row = first + corner * 3u;
        z[corner] = bitcast<vec4f>(blocks[row + shear.axes.x]) - origin[shear.axes.x];
        x[corner] = bitcast<vec4f>(blocks[row + shear.axes.y]) - origin[shear.axes.y] - shear.slopes.x * z[corner];
        y[corner] = bitcast<vec4f>(blocks[row + shear.axes.z]) - origin[shear.axes.z] - shear.slopes.y * z[corner];
    }
    let u = x[2] * y[1] - y[2] * x[1];
    let v = x[0] * y[2] - y[0] * x[2];
    let w = x[1] * y[0] - y[1] * x[0];
    let zero = vec4f(0.0);
    let inside = (min(u, min(v, w)) >= zero) | (max(u, max(v, w)) <= zero);
    let sum = u + v + w;
    let has_area = sum != zero;
    let t = (u * z[0] + v * z[1] + w * z[2]) / select(vec4f(1.0), sum, has_area) * shear.per_length;
    let is_there = blocks[first + 9u] != vec4u(NONE);
    return any(inside & has_area & is_there & (t > zero) & (t < vec4f(END)));
}

// Whether anything is in the way from a place along a direction, of the length of it.
fn trace(root: u32, origin: vec3f, direction: vec3f) -> u32 {
    let size = abs(direction);
    let longest = max(size.x, max(size.y, size.z));
    if !(longest > 0.0) {
        return FREE;
    }
    let least = vec3f(1e-12 * longest);
    let reciprocal = 1.0 / select(direction, least, size < least);
    let is_backward = reciprocal < vec3f(0.0);
    // Rows of the plane that is met first, by axis.
    let near_rows = 2u * select(vec3u(0u, 1u, 2u), vec3u(3u, 4u, 5u), is_backward);
    let far_rows = 2u * select(vec3u(3u, 4u, 5u), vec3u(0u, 1u, 2u), is_backward);
    var axes = vec3u(2u, 0u, 1u);
    if size.x > size.y && size.x > size.z {
        axes = vec3u(0u, 1u, 2u);
    } else if size.y > size.z {
        axes = vec3u(1u, 2u, 0u);
    }
    let per_length = 1.0 / direction[axes.x];
    let shear = Shear(axes, vec2f(direction[axes.y], direction[axes.z]) * per_length, per_length);
    var stack: array<u32, STACK>;
    stack[0] = root;
    var n = 1u;
    while n > 0u {
        n--;
        let top = stack[n];
        if (top & IS_BLOCK) != 0u {
            if meets(top & ~IS_BLOCK, origin, shear) {
                return BLOCKED;
            }
            continue;
        }
        if n + 8u > STACK {
            return UNKNOWN;
        }
        let first = top * NODE_ROWS;
        for (var half = 0u; half < 2u; half++) {
            var near = vec4f(0.0);
            var far = vec4f(END);
            for (var axis = 0u; axis < 3u; axis++) {
                let enters = bitcast<vec4f>(nodes[first + near_rows[axis] + half]);
                let leaves = bitcast<vec4f>(nodes[first + far_rows[axis] + half]);
                near = max(near, (enters - origin[axis]) * reciprocal[axis]);
                far = min(far, (leaves - origin[axis]) * reciprocal[axis]);
            }
            let entered = near <= far * FAR_SLACK;
            let children = nodes[first + 12u + half];
            for (var lane = 0u; lane < 4u; lane++) {
                if entered[lane] {
                    stack[n] = children[lane];
                    n++;
                }
            }
        }
    }
    return FREE;
}

// Light of a point's surface towards the viewer; w is 1 where the CPU has to find it.
fn shaded(point: u32, tile: u32) -> vec4f {
    let first = point * POINT_ROWS;
    let place = bitcast<vec3f>(points[first].xyz);
    let throughput = bitcast<vec3f>(vec3u(points[first].w, points[first + 1u].xy));
    let number = points[first + 1u].z;
    if (number & LEFT) != 0u {
        return vec4f(0.0, 0.0, 0.0, 1.0);
    }
    let ng = unit(points[first + 1u].w);
    let u = fract(shifts[tile] + hammersley(number >> 8u & 15u));
    let light = sent(place, u, number >> 4u & 15u);
    if light.state == UNKNOWN {
        return vec4f(0.0, 0.0, 0.0, 1.0);
    }
    if light.state == 0u || dot(light.wi, ng) <= 0.0 {
        return vec4f(0.0);
    }
    let value = throughput * scattered(first, ng, light.wi) * lamp.emission * light.factor;
    if value.x + value.y + value.z <= 0.0 {
        return vec4f(0.0);
    }
    var way = trace(0u, place, light.toward);
    if way == FREE && lamp.sheer != NONE {
        way = select(FREE, UNKNOWN, trace(lamp.sheer, place, light.toward) != FREE);
    }
    if way == UNKNOWN {
        return vec4f(0.0, 0.0, 0.0, 1.0);
    }
    return vec4f(select(value, vec3f(0.0), way == BLOCKED), 0.0);
}

@compute @workgroup_size(8, 8)
fn lamplight(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= lamp.width || id.y >= lamp.height {
        return;
    }
    let pixel = id.y * lamp.width + id.x;
    let tiles_across = (lamp.width + TILE - 1u) / TILE;
    let tile = (id.y / TILE) * tiles_across + id.x / TILE;
    var sum = vec4f(0.0);
    for (var point = starts[pixel]; point < starts[pixel + 1u]; point++) {
        sum += shaded(point, tile);
    }
    lit[pixel] = vec4f(sum.xyz, select(0.0, 1.0, sum.w > 0.0));
}

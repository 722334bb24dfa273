// Direct light of one lamp at what each pixel sees: for each of its points one point of the lamp, and one ray between them;
// through slabs, solid panes of smooth glass, one more point of the lamp, and the way that the glass bends.
//
// A pixel that has something the device does not know (clear panes and alpha in the way, solids, coats of several layers,
// a flat body close by that is seen from its edge) is left to the CPU as a whole, which finds it with the same numbers: w of its light is 1.

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
    // Of a spot: one minus the cosine of its outer angle; of parallel light: of the angle from the middle of the disk that it comes
    // from to its rim.
    rim: f32,
    // From the middle of a flat body to the middles of two sides; of a lamp without size unit vectors to its right and its upper side.
    half_x: vec3f,
    // Of a spot: one over how much of that its rise takes.
    per_cos: f32,
    half_y: vec3f,
    // Squared distance from the middle of a flat body within which its points are chosen by the angle that it fills, m²; of a
    // sphere the squared radius.
    near: f32,
    // Candela, lux or nit.
    emission: vec3f,
    // Beyond all surfaces, m.
    far: f32,
    // Of a measured distribution: numbers of its vertical and its horizontal angles, 0 of a lamp without one, and whether its planes
    // meet in its aim, 0, or across it, 1.
    n_vertical: u32,
    n_horizontal: u32,
    planes: u32,
    // Where that begins behind the table of coats.
    distribution: u32,
}

@group(0) @binding(0) var<uniform> lamp: Lamp;
// Eight boxes: lower x, y, z, upper x, y, z, then what is in them. 14 rows of four numbers.
@group(0) @binding(1) var<storage, read> nodes: array<vec4u>;
// Four triangles: corner × axis, then their names. 10 rows of four numbers.
@group(0) @binding(2) var<storage, read> blocks: array<vec4u>;
// 4 rows of four numbers each; the number of a point has whether it is left in bit 0, its place among sixteen from bit 4 on, that of
// the sixteen from bit 8 on, and how many slabs light may pass from bit 12 on.
@group(0) @binding(3) var<storage, read> points: array<vec4u>;
// Where the points of each pixel begin, and the number of points.
@group(0) @binding(4) var<storage, read> starts: array<u32>;
// Albedo of coats per f0 and f90, by roughness and by cosine; then the mean of (1 − cos)⁵ by cosine; then factors of facets that
// scatter light repeatedly, by roughness and by cosine. Behind them the lamp's measured distribution: vertical and horizontal angles
// in radians, and what is measured there over the most that is, horizontal × vertical.
@group(0) @binding(5) var<storage, read> coats: array<f32>;
// Random offset of the points on the lamp, by tile.
@group(0) @binding(6) var<storage, read> shifts: array<vec2f>;
@group(0) @binding(7) var<storage, read_write> lit: array<vec4f>;
// A row for all slabs: the diagonal of the scene, and last the row of the first slab. Before that two for each node of a tree of boxes
// around them, each node before all below it: the lower corner and the row of the first node that is not below, or of the first slab
// where there is none; the upper corner, with the row of its own first slab and, from bit 29 on, how many it has, none of a fork. Eight
// for each slab, leaf by leaf: its normal and index of refraction; its middle and thickness; its box, with the row of its first
// triangle, and with the numbers of those of the back and, from bit 16 on, of the front; what it lets pass but for what it reflects,
// and 1 where only the CPU knows; its extinction, and 1 where nothing lies in its glass; the axes of the rectangle around it, each with
// half of its length. Three for each triangle: a corner and the clearance of the plane, and the edges from there.
@group(0) @binding(8) var<storage, read> slabs: array<vec4u>;

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
// Directions so little outside of a measured distribution are within, radians.
const SLACK: f32 = 1e-4;
// A lamp without size has this one next to it, m, and no larger one over a distance beyond everything.
const POINT_RADIUS: f32 = 0.01;
const POINT_OF_FAR: f32 = 1e-3;
// Least height over a flat lamp close by, per distance, and least angle that it fills, sr: numbers of the device tell no less.
const LEAST_HEIGHT: f32 = 0.02;
const LEAST_ANGLE: f32 = 1e-3;
const SLAB_HEAD: u32 = 1u;
const SLAB_NODE_ROWS: u32 = 2u;
const SLAB_ROWS: u32 = 8u;
// Whether the scene has any.
override HAS_SLABS: bool;
// Most slabs that a way goes through.
const IN_A_ROW: u32 = 8u;
// One minus the cosine between normals that count as parallel.
const PARALLEL: f32 = 1e-6;
// Ways that graze the glass more than this are none.
const LEAST_COS: f32 = 0.01;
const NEWTON_STEPS: u32 = 12u;
// How far aside of a straight way light is looked for in a slab, over its thickness.
const MOST_ASIDE: f32 = 4.0;
// Overlap of two slabs along a way, over their thickness, from which on only one of both is gone through.
const OVERLAP: f32 = 0.1;
// Tries to find the slabs that a way goes through.
const TRIES: u32 = 4u;

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

// A direction within a cone around an axis, all of them alike.
fn in_cone(ahead: vec3f, one_minus_cos: f32, u: vec2f) -> vec3f {
    let down = one_minus_cos * u.x;
    let radius = sqrt(max(down * (2.0 - down), 0.0));
    // Two directions at right angles to it. [Duff2017]
    let side = select(-1.0, 1.0, ahead.z >= 0.0);
    let a = -1.0 / (side + ahead.z);
    let b = ahead.x * ahead.y * a;
    let x = vec3f(1.0 + side * ahead.x * ahead.x * a, side * b, -side * ahead.x);
    let y = vec3f(b, side + ahead.y * ahead.y * a, -ahead.y);
    return (x * cos(2.0 * PI * u.y) + y * sin(2.0 * PI * u.y)) * radius + ahead * (1.0 - down);
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
    let wi = in_cone(ahead, one_minus_cos, u);
    let along = dot(wi, to_center);
    let depth = sqrt(max(lamp.near - (square - along * along), 0.0));
    return Sent(wi, 2.0 * PI * one_minus_cos, wi * (along - depth), 1u);
}

// A point of the lamp, and its normal where that has a body.
struct LampPoint {
    position: vec3f,
    normal: vec3f,
}

// One that is chosen evenly.
fn lamp_point(u: vec2f) -> LampPoint {
    if lamp.kind < 3u {
        return LampPoint(lamp.position, lamp.axis);
    }
    if lamp.kind == 5u {
        let z = 1.0 - 2.0 * u.x;
        let around = vec2f(cos(2.0 * PI * u.y), sin(2.0 * PI * u.y)) * sqrt(max(1.0 - z * z, 0.0));
        let normal = vec3f(around, z);
        return LampPoint(lamp.position + normal * sqrt(lamp.near), normal);
    }
    var at = 2.0 * u - 1.0;
    if lamp.kind == 4u {
        at = concentric(u);
    }
    return LampPoint(lamp.position + lamp.half_x * at.x + lamp.half_y * at.y, lamp.axis);
}

// A direction towards the disk that parallel light comes from.
fn toward_disk(u: vec2f) -> vec3f {
    return in_cone(-lamp.axis, lamp.rim, u);
}

// What comes from there: as much to a surface that faces the middle, however large the disk is.
fn sent_from_disk(wi: vec3f) -> Sent {
    return Sent(wi, 2.0 / (2.0 - lamp.rim), wi * lamp.far, 1u);
}

// Angle from the first of two axes towards the second, to the last bits: devices' own may be off by thousands of them.
// [Abramowitz1964, 4.4.49]
fn around(x: f32, y: f32) -> f32 {
    let size = abs(vec2f(x, y));
    let slope = min(size.x, size.y) / max(max(size.x, size.y), 1e-30);
    let square = slope * slope;
    var sum = 0.0028662257;
    sum = sum * square - 0.0161657367;
    sum = sum * square + 0.0429096138;
    sum = sum * square - 0.0752896400;
    sum = sum * square + 0.1065626393;
    sum = sum * square - 0.1420889944;
    sum = sum * square + 0.1999355085;
    sum = sum * square - 0.3333314528;
    sum = sum * square + 1.0;
    var angle = sum * slope;
    angle = select(angle, 0.5 * PI - angle, size.y > size.x);
    angle = select(angle, PI - angle, x < 0.0);
    return select(angle, -angle, y < 0.0);
}

// Which of so many rising angles is the one below an angle, and how far that is on the way to the next; below 0 outside of them.
fn bracket(first: u32, n: u32, angle: f32) -> vec2f {
    if angle < coats[first] - SLACK || angle > coats[first + n - 1u] + SLACK {
        return vec2f(-1.0, 0.0);
    }
    // The first one beyond it, or the last.
    var low = 1u;
    var high = n - 1u;
    while low < high {
        let middle = (low + high) / 2u;
        if coats[first + middle] <= angle {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    let below = coats[first + low - 1u];
    let share = (angle - below) / (coats[first + low] - below);
    return vec2f(f32(low - 1u), clamp(share, 0.0, 1.0));
}

// What a measured distribution has towards a direction over the most that it has, bilinear in its angles.
fn measured(toward: vec3f) -> f32 {
    let right = dot(toward, lamp.half_x);
    let up = dot(toward, lamp.half_y);
    let ahead = dot(toward, lamp.axis);
    let second = lamp.distribution + lamp.n_vertical;
    var vertical = around(ahead, length(vec2f(right, up)));
    var horizontal = around(right, up);
    if lamp.planes == 0u {
        // Once round from the first plane on.
        let turns = (horizontal - coats[second]) / (2.0 * PI);
        horizontal -= floor(turns) * 2.0 * PI;
    } else {
        vertical = around(ahead, right);
        horizontal = around(length(vec2f(right, ahead)), -up);
    }
    let column = bracket(lamp.distribution, lamp.n_vertical, vertical);
    let row = bracket(second, lamp.n_horizontal, horizontal);
    if column.x < 0.0 || row.x < 0.0 {
        return 0.0;
    }
    let at = second + lamp.n_horizontal + u32(row.x) * lamp.n_vertical + u32(column.x);
    let next = at + lamp.n_vertical;
    return mix(mix(coats[at], coats[at + 1u], column.y), mix(coats[next], coats[next + 1u], column.y), row.y);
}

// What a lamp that is somewhere sends to a place.
fn sent_from(on_lamp: LampPoint, place: vec3f) -> Sent {
    let toward = on_lamp.position - place;
    let square = dot(toward, toward);
    if !(square > 0.0) {
        return Sent(vec3f(0.0), 0.0, vec3f(0.0), 0u);
    }
    let wi = toward / sqrt(square);
    if lamp.kind >= 3u {
        let factor = -dot(wi, on_lamp.normal) * lamp.area / square;
        return Sent(wi, factor, toward, select(0u, 1u, factor > 0.0));
    }
    var falloff = 1.0;
    if lamp.n_vertical > 0u {
        falloff = measured(-wi);
    } else if lamp.kind == 1u {
        let aside = wi + lamp.axis;
        let t = clamp((lamp.rim - 0.5 * dot(aside, aside)) * lamp.per_cos, 0.0, 1.0);
        falloff = t * t;
    }
    let closest = min(POINT_RADIUS, POINT_OF_FAR * lamp.far);
    return Sent(wi, falloff / max(square, closest * closest), toward, select(0u, 1u, falloff > 0.0));
}

// Angles of cosines, to the last bits: devices' own may be off by thousands of them. [Abramowitz1964, 4.4.46]
fn angles(cosines: vec4f) -> vec4f {
    let x = abs(cosines);
    var sum = vec4f(-0.0012624911);
    sum = sum * x + 0.0066700901;
    sum = sum * x - 0.0170881256;
    sum = sum * x + 0.0308918810;
    sum = sum * x - 0.0501743046;
    sum = sum * x + 0.0889789874;
    sum = sum * x - 0.2145988016;
    sum = sum * x + 1.5707963050;
    sum *= sqrt(max(1.0 - x, vec4f(0.0)));
    return select(sum, PI - sum, cosines < vec4f(0.0));
}

// What a flat lamp close by sends to a place, by the angle that its rectangle fills: a disk lets what is beside it go dark. [Urena2013]
fn sent_by_plate(place: vec3f, u: vec2f) -> Sent {
    let nothing = Sent(vec3f(0.0), 0.0, vec3f(0.0), 0u);
    let to_middle = lamp.position - place;
    let z = dot(to_middle, lamp.axis);
    if z >= 0.0 {
        return nothing;
    }
    let size = vec2f(length(lamp.half_x), length(lamp.half_y));
    let x_axis = lamp.half_x / size.x;
    let y_axis = lamp.half_y / size.y;
    let middle = vec2f(dot(to_middle, x_axis), dot(to_middle, y_axis));
    let low = middle - size;
    let high = middle + size;
    // Across the lamp's plane: the normals of the planes through the place and each side.
    let sides = vec4f(-low.y, high.x, high.y, -low.x);
    let across = sides / sqrt(z * z + sides * sides);
    let corners = angles(-across * across.yzwx);
    let angle = dot(corners, vec4f(1.0)) - 2.0 * PI;
    if -z < LEAST_HEIGHT * length(to_middle) || angle < LEAST_ANGLE {
        return Sent(vec3f(0.0), 0.0, vec3f(0.0), UNKNOWN);
    }
    let around = u.x * angle + 2.0 * PI - corners.z - corners.w;
    let slope = (cos(around) * across.x - across.z) / sin(around);
    let cosine = min(1.0 / sqrt(slope * slope + across.x * across.x), 1.0) * select(1.0, -1.0, slope < 0.0);
    let x = clamp(-cosine * z / sqrt(max(1.0 - cosine * cosine, 1e-30)), low.x, high.x);
    let square = x * x + z * z;
    let ends = vec2f(low.y, high.y) / sqrt(square + vec2f(low.y * low.y, high.y * high.y));
    let h = mix(ends.x, ends.y, u.y);
    let y = clamp(h * sqrt(square / max(1.0 - h * h, 1e-30)), low.y, high.y);
    let aside = vec2f(x, y) - middle;
    if lamp.kind == 4u && dot(aside, aside) > size.x * size.x {
        return nothing;
    }
    let toward = x_axis * x + y_axis * y + lamp.axis * z;
    return Sent(normalize(toward), angle, toward, 1u);
}

// What the lamp sends straight to a place: neighbors share `u`, and `own` is the place's alone.
fn sent(place: vec3f, u: vec2f, own: vec2f) -> Sent {
    if lamp.kind == 2u {
        return sent_from_disk(toward_disk(own));
    }
    if lamp.kind == 5u {
        return sent_by_sphere(place, own);
    }
    let from_middle = place - lamp.position;
    if lamp.kind >= 3u && dot(from_middle, from_middle) < lamp.near {
        return sent_by_plate(place, own);
    }
    return sent_from(lamp_point(u), place);
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

// One over a direction, whose components hardly vanish.
fn per_axis(direction: vec3f) -> vec3f {
    let size = abs(direction);
    let least = vec3f(1e-12 * max(size.x, max(size.y, size.z)));
    return 1.0 / select(direction, least, size < least);
}

// Whether anything is in the way from a place along a direction, of the length of it.
fn trace(root: u32, origin: vec3f, direction: vec3f) -> u32 {
    let size = abs(direction);
    let longest = max(size.x, max(size.y, size.z));
    if !(longest > 0.0) {
        return FREE;
    }
    let reciprocal = per_axis(direction);
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

// The same, and what lets some light pass.
fn free(origin: vec3f, direction: vec3f) -> u32 {
    let way = trace(0u, origin, direction);
    if way == FREE && lamp.sheer != NONE {
        return select(FREE, UNKNOWN, trace(lamp.sheer, origin, direction) != FREE);
    }
    return way;
}

// A way through slabs: their rows, in its order.
struct Route {
    slabs: array<u32, IN_A_ROW>,
    // NONE where only the CPU knows.
    n: u32,
    // Outside of the glass.
    direction: vec3f,
    // What stands for one over the squared distance of the ends.
    closeness: f32,
}

// Slabs that a straight way goes through, or by, in its order.
struct Met {
    slabs: array<u32, IN_A_ROW>,
    // Where it comes to the middle of the glass, half of what it is in there, and how far off it is, below 0 where it goes through.
    meetings: array<vec3f, IN_A_ROW>,
    n: u32,
}

fn slab_row(row: u32) -> vec4f {
    return bitcast<vec4f>(slabs[row]);
}

fn thickness(slab: u32) -> f32 {
    return slab_row(slab + 1u).w;
}

// From the middle of a slab.
fn from_middle(slab: u32, place: vec3f) -> vec3f {
    return place - slab_row(slab + 1u).xyz;
}

// Whether a box of two rows shares a point with another one.
fn overlaps(row: u32, low: vec3f, high: vec3f) -> bool {
    return all(slab_row(row).xyz <= high) && all(low <= slab_row(row + 1u).xyz);
}

// A walk through the tree of slabs along a straight way.
struct Walk {
    start: vec3f,
    // One over the way, by axis.
    reciprocal: vec3f,
    // The box around the way.
    low: vec3f,
    high: vec3f,
    // Rows of the node and of the slab that come next, and where the slabs of this leaf end.
    node: u32,
    slab: u32,
    end: u32,
}

fn walk_between(start: vec3f, goal: vec3f) -> Walk {
    return Walk(start, per_axis(goal - start), min(start, goal), max(start, goal), SLAB_HEAD, 0u, 0u);
}

// Whether the way of a walk meets the box of a node.
fn is_met(node: u32, walk: ptr<function, Walk>) -> bool {
    if !overlaps(node, (*walk).low, (*walk).high) {
        return false;
    }
    let a = (slab_row(node).xyz - (*walk).start) * (*walk).reciprocal;
    let b = (slab_row(node + 1u).xyz - (*walk).start) * (*walk).reciprocal;
    let near = min(a, b);
    let far = max(a, b);
    return max(max(near.x, near.y), max(near.z, 0.0)) <= min(min(far.x, far.y), min(far.z, 1.0));
}

// The next slab whose box a walk may meet; NONE at its end. The order is that of the CPU, as of slabs side by side the first may count.
fn next_slab(walk: ptr<function, Walk>) -> u32 {
    while (*walk).slab == (*walk).end {
        let node = (*walk).node;
        if node >= slabs[0].w {
            return NONE;
        }
        if is_met(node, walk) {
            let own = slabs[node + 1u].w;
            (*walk).slab = own & 0x1fffffffu;
            (*walk).end = (*walk).slab + SLAB_ROWS * (own >> 29u);
            (*walk).node = node + SLAB_NODE_ROWS;
        } else {
            (*walk).node = slabs[node].w;
        }
    }
    let slab = (*walk).slab;
    (*walk).slab = slab + SLAB_ROWS;
    return slab;
}

// Whether two places are outside of the glass of a slab on either side.
fn parts(slab: u32, start: vec3f, goal: vec3f) -> bool {
    let normal = slab_row(slab).xyz;
    let half = 0.5 * thickness(slab);
    let sides = vec2f(dot(normal, from_middle(slab, start)), dot(normal, from_middle(slab, goal)));
    return min(sides.x, sides.y) < -half && max(sides.x, sides.y) > half;
}

// How far a place in the plane of a face is beside the rectangle around it.
fn excess(slab: u32, place: vec3f) -> f32 {
    let x = slab_row(slab + 6u);
    let y = slab_row(slab + 7u);
    let aside = from_middle(slab, place);
    return max(abs(dot(x.xyz, aside)) - x.w, abs(dot(y.xyz, aside)) - y.w);
}

// Whether a face has a place in its plane; of a slab that only the CPU knows its whole rectangle does.
fn has(slab: u32, is_front: bool, place: vec3f) -> bool {
    return excess(slab, place) <= 0.0 && (slabs[slab + 4u].w != 0u || on_face(slab, is_front, place).w >= 0.0);
}

// How a straight way meets a slab that its ends are on either side of; y is below 0 where it is too far off.
fn meeting(slab: u32, start: vec3f, goal: vec3f) -> vec3f {
    let normal = slab_row(slab).xyz;
    let toward = goal - start;
    let depth = dot(normal, toward);
    let t = -dot(normal, from_middle(slab, start)) / depth;
    let place = start + toward * t;
    let beside = excess(slab, place);
    if beside > 0.0 {
        let tangent = sqrt(max(dot(toward, toward) / (depth * depth) - 1.0, 0.0));
        if beside > thickness(slab) * min(2.0 * tangent, MOST_ASIDE) {
            return vec3f(0.0, -1.0, 0.0);
        }
    }
    return vec3f(t, 0.5 * thickness(slab) / abs(depth), select(max(beside, 0.0), -1.0, has(slab, true, place)));
}

// Whether a way goes through one of two slabs alone, as they lie side by side.
fn are_rivals(a: vec3f, b: vec3f) -> bool {
    return abs(a.x - b.x) < (1.0 - OVERLAP) * (a.y + b.y);
}

// The slabs that the way between two places may go through; none where there are too many.
fn met(start: vec3f, goal: vec3f) -> Met {
    var found = Met();
    var walk = walk_between(start, goal);
    for (var slab = next_slab(&walk); slab != NONE; slab = next_slab(&walk)) {
        if !overlaps(slab + 2u, walk.low, walk.high) || !parts(slab, start, goal) {
            continue;
        }
        let one = meeting(slab, start, goal);
        if one.y < 0.0 {
            continue;
        }
        var is_nearest = true;
        var kept = 0u;
        for (var i = 0u; i < found.n; i++) {
            is_nearest = is_nearest && !(are_rivals(found.meetings[i], one) && found.meetings[i].z <= one.z);
        }
        if !is_nearest {
            continue;
        }
        for (var i = 0u; i < found.n; i++) {
            if !are_rivals(found.meetings[i], one) {
                found.meetings[kept] = found.meetings[i];
                found.slabs[kept] = found.slabs[i];
                kept++;
            }
        }
        if kept == IN_A_ROW {
            return Met();
        }
        var at = kept;
        for (; at > 0u; at--) {
            if found.meetings[at - 1u].x <= one.x {
                break;
            }
            found.meetings[at] = found.meetings[at - 1u];
            found.slabs[at] = found.slabs[at - 1u];
        }
        found.meetings[at] = one;
        found.slabs[at] = slab;
        found.n = kept + 1u;
    }
    return found;
}

// Distance at which a ray enters a slab between two places; not above 0 where it does not.
fn entered(slab: u32, start: vec3f, direction: vec3f) -> f32 {
    let normal = slab_row(slab).xyz;
    let along = dot(normal, direction);
    let half = 0.5 * thickness(slab);
    let t = (select(-half, half, along < 0.0) - dot(normal, from_middle(slab, start))) / along;
    if abs(along) < LEAST_COS || !(t > 0.0) || !has(slab, along < 0.0, start + direction * t) {
        return 0.0;
    }
    return t;
}

// Where light leaves a slab that comes into it at a place.
fn through(slab: u32, into: vec3f, direction: vec3f) -> vec3f {
    let upright = slab_row(slab);
    let along = dot(direction, upright.xyz);
    let normal = upright.xyz * select(1.0, -1.0, along < 0.0);
    let sideways = (direction - normal * abs(along)) / upright.w;
    let depth = sqrt(1.0 - dot(sideways, sideways));
    return into + (sideways + normal * depth) * (thickness(slab) / depth);
}

// The way from a place in a direction through the slabs on it before another one; none where there are too many.
fn followed(start: vec3f, goal: vec3f, direction: vec3f) -> Route {
    var route = Route();
    route.direction = direction;
    route.closeness = 1.0;
    var at = start;
    let reach = direction * distance(start, goal);
    loop {
        var nearest = 0.0;
        var next = NONE;
        var into = at;
        var walk = walk_between(at, at + reach);
        for (var slab = next_slab(&walk); slab != NONE; slab = next_slab(&walk)) {
            if !overlaps(slab + 2u, walk.low, walk.high) || !parts(slab, start, goal) {
                continue;
            }
            let t = entered(slab, at, direction);
            if t > 0.0 && (next == NONE || t < nearest) {
                nearest = t;
                next = slab;
                into = at + direction * t;
            }
        }
        if next == NONE {
            break;
        }
        if route.n == IN_A_ROW {
            return Route();
        }
        at = through(next, into, direction);
        route.slabs[route.n] = next;
        route.n++;
    }
    return route;
}

// How far a way gets aside whose angle outside has this tangent, over the sine of that, and per radian.
fn bend(route: ptr<function, Route>, air: f32, tangent: f32) -> vec2f {
    let cosine = 1.0 / sqrt(1.0 + tangent * tangent);
    let sine = tangent * cosine;
    var aside = vec2f(air / cosine, air / (cosine * cosine));
    for (var i = 0u; i < (*route).n; i++) {
        let slab = (*route).slabs[i];
        let ior = slab_row(slab).w;
        let squared = ior * ior - sine * sine;
        let per_root = thickness(slab) / sqrt(squared);
        aside += per_root * vec2f(1.0, ior * ior * cosine / squared);
    }
    return aside;
}

// Turns a route to the direction that it has between two places if its slabs were endless; none where that grazes them, and only the
// CPU knows where they are not parallel.
fn turn(route: ptr<function, Route>, start: vec3f, goal: vec3f) {
    let toward = goal - start;
    var normal = slab_row((*route).slabs[0]).xyz;
    normal *= select(1.0, -1.0, dot(normal, toward) < 0.0);
    let depth = dot(normal, toward);
    var air = depth;
    // As small angles would be bent.
    var shallow = depth;
    for (var i = 0u; i < (*route).n; i++) {
        let slab = (*route).slabs[i];
        if abs(dot(slab_row(slab).xyz, normal)) <= 1.0 - PARALLEL {
            (*route).n = NONE;
            return;
        }
        let glass = thickness(slab);
        air -= glass;
        shallow -= glass - glass / slab_row(slab).w;
    }
    if !(air > 0.0) {
        (*route).n = 0u;
        return;
    }
    let aside = toward - normal * depth;
    let away = length(aside);
    // From below: each step of Newton's stays there.
    var tangent = away / shallow;
    var reach = bend(route, air, tangent);
    for (var nth = 0u; nth < NEWTON_STEPS; nth++) {
        let square_cosine = 1.0 / (1.0 + tangent * tangent);
        let excess = reach.x * tangent * sqrt(square_cosine) - away;
        let next = tangent - excess / (reach.y * square_cosine);
        if !(next > tangent) {
            break;
        }
        tangent = next;
        reach = bend(route, air, tangent);
    }
    let cosine = 1.0 / sqrt(1.0 + tangent * tangent);
    (*route).direction = (normal + aside / max(away, 1e-30) * tangent) * cosine;
    (*route).closeness = 1.0 / (reach.x * reach.y * cosine);
    if cosine < LEAST_COS {
        (*route).n = 0u;
    }
}

// The way between two places through just the slabs that it meets, sought from some that it may meet.
fn settled(row: Route, start: vec3f, goal: vec3f) -> Route {
    var route = row;
    for (var nth = 0u; nth < TRIES && route.n > 0u; nth++) {
        turn(&route, start, goal);
        if route.n == 0u || route.n == NONE {
            return route;
        }
        var way = followed(start, goal, route.direction);
        var is_same = way.n == route.n;
        for (var i = 0u; i < route.n; i++) {
            is_same = is_same && way.slabs[i] == route.slabs[i];
        }
        if is_same {
            return route;
        }
        route = way;
    }
    return Route();
}

// The one way between two places through the slabs between them; through none where there is none.
fn bent(start: vec3f, goal: vec3f) -> Route {
    var found = met(start, goal);
    if found.n == 0u {
        return Route();
    }
    var row = Route();
    row.slabs = found.slabs;
    row.n = found.n;
    let route = settled(row, start, goal);
    if route.n > 0u {
        return route;
    }
    // Those alone that the straight way goes through.
    var straight = Route();
    for (var i = 0u; i < found.n; i++) {
        if found.meetings[i].z < 0.0 {
            straight.slabs[straight.n] = found.slabs[i];
            straight.n++;
        }
    }
    if straight.n == found.n {
        return route;
    }
    return settled(straight, start, goal);
}

// What a point of the lamp sends to a place through slabs, and the way of that; nothing where there are none.
fn sent_through(place: vec3f, u: vec2f, route: ptr<function, Route>) -> Sent {
    let on_lamp = lamp_point(u);
    var beyond = vec3f(0.0);
    if lamp.kind == 2u {
        beyond = toward_disk(u);
        *route = followed(place, place + beyond * lamp.far, beyond);
    } else {
        *route = bent(place, on_lamp.position);
    }
    if (*route).n == 0u || (*route).n == NONE {
        return Sent(vec3f(0.0), 0.0, vec3f(0.0), select(0u, UNKNOWN, (*route).n == NONE));
    }
    if lamp.kind == 2u {
        return sent_from_disk(beyond);
    }
    // From there the lamp looks, without slabs, as it does from here through them.
    let eye = on_lamp.position - (*route).direction / sqrt((*route).closeness);
    var light = sent_from(on_lamp, eye);
    light.toward = on_lamp.position - place;
    return light;
}

// The point of the triangle of a face that has a place, and its clearance; below 0 where none has it.
fn on_face(slab: u32, is_front: bool, place: vec3f) -> vec4f {
    let numbers = slabs[slab + 3u].w;
    let n_back = numbers & 0xffffu;
    let first = slabs[slab + 2u].w + select(0u, 3u * n_back, is_front);
    let end = first + 3u * select(n_back, numbers >> 16u, is_front);
    for (var row = first; row < end; row += 3u) {
        let corner = slab_row(row);
        let ab = slab_row(row + 1u).xyz;
        let ac = slab_row(row + 2u).xyz;
        let ap = place - corner.xyz;
        let across = cross(ab, ac);
        let per_area = 1.0 / dot(across, across);
        let u = dot(cross(ap, ac), across) * per_area;
        let v = dot(cross(ab, ap), across) * per_area;
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
            return vec4f(corner.xyz + ab * u + ac * v, corner.w);
        }
    }
    return vec4f(place, -1.0);
}

// Where a ray begins that leaves a place of a slab to the side of a normal. [Wachter2019]
fn lifted(place: vec3f, normal: vec3f) -> vec3f {
    let steps = vec3i(256.0 * normal);
    let moved = bitcast<vec3f>(bitcast<vec3i>(place) + select(steps, -steps, place < vec3f(0.0)));
    let near_zero = min(1.0 / 65536.0, 256.0 * 1.1920929e-7 * slab_row(0u).x);
    return select(moved, place + near_zero * normal, abs(place) < vec3f(1.0 / 32.0));
}

// Share of light that goes through an interface into what is denser.
fn refracted(cosine: f32, ior: f32) -> f32 {
    let behind = sqrt(1.0 - (1.0 - cosine * cosine) / (ior * ior));
    let parallel = (ior * cosine - behind) / (ior * cosine + behind);
    let perpendicular = (cosine - ior * behind) / (cosine + ior * behind);
    return 1.0 - 0.5 * (parallel * parallel + perpendicular * perpendicular);
}

// Where a way goes through a face of a slab, where that is on the face's triangle, the normal there along it, what of the light
// passes, and how far off the face rays begin; below 0 where the way misses it.
struct Crossing {
    place: vec3f,
    clearance: f32,
    on_face: vec3f,
    normal: vec3f,
    share: vec3f,
}

// The next face of a slab on a way that has come to a place, before the glass or in it.
fn crossing(slab: u32, direction: vec3f, at: vec3f, is_inside: bool) -> Crossing {
    let upright = slab_row(slab);
    let along = dot(direction, upright.xyz);
    var next = Crossing(at, -1.0, at, upright.xyz * select(1.0, -1.0, along < 0.0), vec3f(1.0));
    if is_inside {
        next.place = through(slab, at, direction);
        let one_face = refracted(abs(along), upright.w);
        let absorbed = slab_row(slab + 5u).xyz * distance(at, next.place);
        next.share = slab_row(slab + 4u).xyz * exp(-absorbed) * one_face * one_face;
    } else {
        let half = 0.5 * thickness(slab);
        let t = (select(-half, half, along < 0.0) - dot(upright.xyz, from_middle(slab, at))) / along;
        next.place = at + direction * t;
    }
    let found = on_face(slab, (along < 0.0) != is_inside, next.place);
    next.on_face = found.xyz;
    next.clearance = found.w;
    return next;
}

// Share of light that comes along a way; nothing where something is in it.
struct Passed {
    share: vec3f,
    way: u32,
}

// Along a route from a place to what lies straight toward there; straight on where the route has no slabs.
fn passed(route: ptr<function, Route>, place: vec3f, toward: vec3f) -> Passed {
    var share = vec3f(1.0);
    // Where the route is, and where the next ray begins.
    var at = place;
    var start = place;
    let n_faces = 2u * (*route).n;
    for (var leg = 0u; leg <= n_faces; leg++) {
        var next = Crossing();
        var ray = select(place, at, lamp.kind == 2u) - start + toward;
        // Nothing is in the way from face to face of glass where nothing lies.
        var is_free = false;
        if leg < n_faces {
            let slab = (*route).slabs[leg / 2u];
            is_free = leg % 2u == 1u && slabs[slab + 5u].w != 0u;
            if slabs[slab + 4u].w != 0u {
                return Passed(vec3f(0.0), UNKNOWN);
            }
            next = crossing(slab, (*route).direction, at, leg % 2u == 1u);
            if next.clearance < 0.0 {
                return Passed(vec3f(0.0), BLOCKED);
            }
            share *= next.share;
            ray = next.on_face - start;
        }
        if !is_free {
            let way = free(start, ray);
            if way != FREE {
                return Passed(vec3f(0.0), way);
            }
        }
        at = next.place;
        start = lifted(next.on_face + next.normal * next.clearance, next.normal);
    }
    return Passed(share, FREE);
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
    let own = fract(u + lattice(1u + (number >> 4u & 15u)));
    var sum = vec3f(0.0);
    // Straight on, and through slabs where there are any.
    for (var nth = 0u; nth < select(1u, 2u, HAS_SLABS); nth++) {
        var route = Route();
        var light: Sent;
        if HAS_SLABS && nth == 1u {
            light = sent_through(place, own, &route);
            // Faces count as bounces, of which a bake may have a limit.
            if light.state == 1u && route.n > ((number >> 12u) & 15u) {
                continue;
            }
        } else {
            light = sent(place, u, own);
        }
        if light.state == UNKNOWN {
            return vec4f(0.0, 0.0, 0.0, 1.0);
        }
        if light.state == 0u || dot(light.wi, ng) <= 0.0 {
            continue;
        }
        let value = throughput * scattered(first, ng, light.wi) * lamp.emission * light.factor;
        if value.x + value.y + value.z <= 0.0 {
            continue;
        }
        var found = Passed(vec3f(1.0), FREE);
        if HAS_SLABS {
            found = passed(&route, place, light.toward);
        } else {
            found.way = free(place, light.toward);
        }
        if found.way == UNKNOWN {
            return vec4f(0.0, 0.0, 0.0, 1.0);
        }
        // Where something is in the way.
        if found.way == FREE {
            sum += value * found.share;
        }
    }
    return vec4f(sum, 0.0);
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

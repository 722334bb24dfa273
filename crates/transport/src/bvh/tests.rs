//! Laws of the tree: brute force agrees, nothing leaks, every way of asking gives the same answer.

use glam::{DVec3, Quat, Vec3};

use super::dispatch::Instructions;
use super::packet::Packet;
use super::{Bvh, Hit, Ray};

/// Repeatable random numbers: the same on every machine.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }

    fn point(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f32) as usize).min(n - 1)
    }
}

fn soup(random: &mut Random, n: usize, size: f32, scale: f32) -> Vec<[Vec3; 3]> {
    (0..n)
        .map(|_| {
            let center = random.point();
            [0; 3].map(|_| (center + random.point() * size) * scale)
        })
        .collect()
}

fn build(triangles: &[[Vec3; 3]]) -> Bvh {
    Bvh::build(triangles, &(0..triangles.len() as u32).collect::<Vec<_>>())
}

fn portable(bvh: &Bvh) -> Bvh {
    Bvh { instructions: Instructions::Baseline, ..bvh.clone() }
}

fn endless(origin: Vec3, direction: Vec3) -> Ray {
    Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
}

/// Möller and Trumbore in double precision: the hit, and how far inside the triangle it lies (negative outside).
fn intersect(ray: &Ray, triangle: &[Vec3; 3]) -> (f64, f64, f64, f64) {
    let [a, b, c] = triangle.map(Vec3::as_dvec3);
    let (origin, direction): (DVec3, DVec3) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (ab, ac, ao) = (b - a, c - a, origin - a);
    let p = direction.cross(ac);
    let scale = 1.0 / ab.dot(p);
    let (u, q) = (ao.dot(p) * scale, ao.cross(ab));
    let v = direction.dot(q) * scale;
    (ac.dot(q) * scale, u, v, u.min(v).min(1.0 - u - v))
}

/// The closest hit by trying all triangles; nothing where rounding could tip the answer.
fn brute_force(triangles: &[[Vec3; 3]], ray: &Ray) -> Option<Option<Hit>> {
    let mut hits = Vec::new();
    for (id, triangle) in triangles.iter().enumerate() {
        let (t, u, v, margin) = intersect(ray, triangle);
        let within = t > f64::from(ray.t_min) && t < f64::from(ray.t_max);
        if margin.abs() < 1e-3 && t > 0.0 {
            return None;
        }
        if margin > 0.0 && within {
            hits.push(Hit { t: t as f32, u: u as f32, v: v as f32, triangle: id as u32 });
        }
    }
    hits.sort_by(|a, b| a.t.total_cmp(&b.t));
    let tied = hits.len() > 1 && hits[1].t < hits[0].t * 1.0001;
    (!tied).then(|| hits.first().copied())
}

#[track_caller]
fn assert_agrees(bvh: &Bvh, ray: &Ray, expected: Option<Hit>) {
    match (bvh.closest(ray), expected) {
        (None, None) => {}
        (Some(hit), Some(expected)) => {
            assert_eq!(hit.triangle, expected.triangle, "{ray:?}: {hit:?} against {expected:?}");
            assert!((hit.t / expected.t - 1.0).abs() < 1e-3, "{ray:?}: {hit:?} against {expected:?}");
            let difference = (hit.u - expected.u).abs().max((hit.v - expected.v).abs());
            assert!(difference < 1e-2, "{ray:?}: {hit:?} against {expected:?}");
        }
        (hit, expected) => panic!("{ray:?}: {hit:?} against {expected:?}"),
    }
}

#[test]
fn the_closest_hit_is_that_of_brute_force() {
    for (seed, n, size, scale) in [
        (1, 1, 1.0, 1.0),
        (2, 3, 1.0, 1.0),
        (3, 40, 0.5, 1.0),
        (4, 3000, 0.1, 1.0),
        (5, 500, 0.2, 1e6),
        (6, 500, 0.2, 1e-4),
    ] {
        let mut random = Random(seed);
        let triangles = soup(&mut random, n, size, scale);
        let bvh = build(&triangles);
        let (n_rays, mut n_compared, mut n_hits) = (1000, 0, 0);
        for _ in 0..n_rays {
            let t_max = if random.unit() < 0.5 { f32::INFINITY } else { random.unit() };
            let (origin, direction) = (random.point() * scale, random.point() * scale);
            let ray = Ray { origin, direction, t_min: 0.1 * random.unit(), t_max };
            if let Some(expected) = brute_force(&triangles, &ray) {
                assert_agrees(&bvh, &ray, expected);
                n_compared += 1;
                n_hits += usize::from(expected.is_some());
            }
        }
        assert!(n_compared > n_rays / 2 && n_hits > 0, "seed {seed}: {n_compared} compared, {n_hits} hits");
    }
}

#[test]
fn all_instructions_and_all_questions_agree_to_the_bit() {
    let mut random = Random(11);
    let triangles = soup(&mut random, 5000, 0.05, 3.0);
    let bvh = build(&triangles);
    let baseline = portable(&bvh);
    for _ in 0..20_000 {
        let ray = Ray { t_max: 2.0 * random.unit(), ..endless(random.point() * 4.0, random.point()) };
        let hit = bvh.closest(&ray);
        assert_eq!(hit, baseline.closest(&ray));
        assert_eq!(hit.is_some(), bvh.occluded(&ray));
        assert_eq!(hit.is_some(), baseline.occluded(&ray));
    }
}

fn assert_fan_equals_singles(bvh: &Bvh, origin: Vec3, targets: &[Vec3; 16], n: usize) -> u32 {
    let [t_min, t_max] = [1e-4, 0.999];
    let visible = bvh.visible16(origin, targets, n, t_min, t_max);
    assert_eq!(visible, portable(bvh).visible16(origin, targets, n, t_min, t_max));
    for (i, &target) in targets.iter().enumerate().take(n) {
        let occluded = bvh.occluded(&Ray { origin, direction: target - origin, t_min, t_max });
        assert_eq!(visible >> i & 1 == 0, occluded, "segment {i} from {origin} to {target}");
    }
    assert_eq!(u32::from(visible) >> n, 0, "bits beyond the {n} targets");
    u32::from(visible).count_ones()
}

#[test]
fn a_fan_sees_what_single_segments_see() {
    let mut random = Random(21);
    let bvh = build(&soup(&mut random, 1200, 0.1, 1.0));
    for spread in [0.0, 1e-3, 0.1, 0.5, 2.0] {
        let (mut n_segments, mut n_visible) = (0, 0);
        for fan in 0..1500 {
            let (origin, center, n) = (random.point(), random.point(), 1 + fan % 16);
            let targets = [0; 16].map(|_| center + random.point() * spread);
            n_visible += assert_fan_equals_singles(&bvh, origin, &targets, n) as usize;
            n_segments += n;
        }
        assert!(n_visible * 10 > n_segments && n_visible * 10 < n_segments * 9, "spread {spread}: {n_visible}");
    }
}

#[test]
fn a_fan_onto_a_panel_along_an_axis_sees_what_single_segments_see() {
    let mut random = Random(22);
    let bvh = build(&soup(&mut random, 300, 0.1, 1.0));
    for _ in 0..1000 {
        let (axis, sign) = (random.below(3), if random.unit() < 0.5 { -1.0 } else { 1.0 });
        let origin = (random.point() * 4.0).round() / 4.0;
        let targets = std::array::from_fn(|i| {
            let mut target = Vec3::splat(sign);
            target[(axis + 1) % 3] = (i % 4) as f32 * 0.25;
            target[(axis + 2) % 3] = (i / 4) as f32 * 0.25;
            target
        });
        assert_fan_equals_singles(&bvh, origin, &targets, 16);
    }
}

#[test]
fn targets_that_are_no_directions_are_free() {
    let bvh = build(&[[Vec3::new(-9.0, -9.0, 0.5), Vec3::new(9.0, -9.0, 0.5), Vec3::new(0.0, 9.0, 0.5)]]);
    let mut targets = [Vec3::Z; 16];
    (targets[3], targets[4], targets[5]) = (Vec3::ZERO, Vec3::NAN, -Vec3::Z);
    assert_eq!(bvh.visible16(Vec3::ZERO, &targets, 16, 0.0, 1.0), 0b11_1000);
    assert_eq!(bvh.visible16(Vec3::ZERO, &targets, 0, 0.0, 1.0), 0);
}

/// Holds a packet against single rays, to the bit; how many of them hit something.
#[track_caller]
fn assert_packet_equals_singles(
    bvh: &Bvh,
    origin: Vec3,
    directions: &[Vec3; 16],
    n: usize,
    ends: (f32, [f32; 16]),
) -> usize {
    let (t_min, t_max) = ends;
    let bits = |hit: Hit| ([hit.t, hit.u, hit.v].map(f32::to_bits), hit.triangle);
    for bvh in [bvh, &portable(bvh)] {
        let hits = bvh.closest16(origin, directions, n, t_min, &t_max);
        for (i, &direction) in directions.iter().enumerate() {
            let ray = Ray { origin, direction, t_min, t_max: t_max[i] };
            let expected = if i < n { bvh.closest(&ray) } else { None };
            assert_eq!(hits[i].map(bits), expected.map(bits), "ray {i} of {n}, {ray:?}");
        }
    }
    bvh.closest16(origin, directions, n, t_min, &t_max).iter().flatten().count()
}

const ENDLESS: (f32, [f32; 16]) = (0.0, [f32::INFINITY; 16]);

#[test]
fn a_packet_hits_what_single_rays_hit() {
    let mut random = Random(23);
    for (n_triangles, size) in [(40, 0.5), (1200, 0.1), (5000, 0.03)] {
        let bvh = build(&soup(&mut random, n_triangles, size, 1.0));
        for spread in [0.0, 1e-5, 1e-3, 0.03, 0.1, 0.5, 2.0] {
            let (mut n_rays, mut n_hits) = (0, 0);
            for packet in 0..400 {
                let (origin, toward, n) = (random.point(), random.point(), 1 + packet % 16);
                let directions = [0; 16].map(|_| toward - origin + random.point() * spread);
                n_hits += assert_packet_equals_singles(&bvh, origin, &directions, n, ENDLESS);
                let t_max = [0; 16].map(|_| random.unit() * 2.0);
                assert_packet_equals_singles(&bvh, origin, &directions, n, (0.2 * random.unit(), t_max));
                n_rays += n;
            }
            assert!(n_hits * 10 > n_rays, "{n_triangles} triangles, spread {spread}: {n_hits} of {n_rays}");
        }
    }
}

#[test]
fn a_packet_goes_through_the_tree_together() {
    let mut random = Random(24);
    let bvh = build(&soup(&mut random, 1200, 0.1, 1.0));
    let (mut n_alone, mut n) = (0, 0);
    for _ in 0..400 {
        let (origin, toward) = (random.point(), random.point());
        let directions = [0; 16].map(|_| toward - origin + random.point() * 0.01);
        n_alone += Packet::new(origin, &directions, u16::MAX, 0.0, &ENDLESS.1).n_alone(&bvh.tree);
        n += 16;
    }
    assert!(n_alone * 4 < n, "{n_alone} of {n} went by themselves");
}

/// Directions through neighboring pixels, 4 × 4 of them, of a picture that looks along `forward`.
fn of_pixels(forward: Vec3, place: [f32; 2], pixel: f32) -> [Vec3; 16] {
    let (right, up) = forward.any_orthonormal_pair();
    std::array::from_fn(|i| {
        let [x, y] = [place[0] + (i % 4) as f32 * pixel, place[1] + (i / 4) as f32 * pixel];
        (forward + right * x + up * y).normalize()
    })
}

#[test]
fn a_packet_hits_what_single_rays_hit_in_a_box_along_the_axes() {
    // Flat boxes around what is flat, at which distances of box and hit differ by rounding alone, and edges that many rays run into.
    let mut random = Random(25);
    for (n, jitter, rotation) in
        [(1, 0.0, Quat::IDENTITY), (16, 0.0, Quat::IDENTITY), (16, 0.02, Quat::from_rotation_x(0.7))]
    {
        let closed = ClosedBox::new(&mut random, n, jitter, rotation);
        let bvh = build(&closed.triangles);
        for packet in 0..1200 {
            let origin = random.point() * 0.9;
            let directions = match packet % 3 {
                0 => of_pixels(random.point().normalize(), [0, 1].map(|_| random.unit() - 0.5), 0.01 * random.unit()),
                1 => {
                    let seam = closed.seam(&mut random);
                    [0; 16].map(|_| seam - origin + random.point() * 1e-6)
                }
                _ => {
                    let middle = closed.seam(&mut random);
                    [0; 16].map(|_| middle.lerp(closed.seam(&mut random), 0.05) - origin)
                }
            };
            assert_packet_equals_singles(&bvh, origin, &directions, 16, ENDLESS);
            // From a point on a side, where rays begin that leave it.
            let seam = closed.seam(&mut random);
            assert_packet_equals_singles(&bvh, seam, &directions, 16, ENDLESS);
        }
    }
}

#[test]
fn a_packet_sees_coincident_triangles_as_single_rays_do() {
    let mut random = Random(26);
    for flat in [true, false] {
        let mut triangles = soup(&mut random, 60, 0.5, 1.0);
        if flat {
            triangles.iter_mut().flatten().for_each(|corner| corner.y = 0.25);
        }
        // Each three times, and some a few steps of rounding apart.
        let again: Vec<_> = triangles.iter().map(|triangle| triangle.map(|corner| corner + Vec3::Y * 1e-7)).collect();
        let bvh = build(&[triangles.clone(), triangles.clone(), triangles, again].concat());
        for _ in 0..1500 {
            let (origin, toward) = (random.point() * 2.0, random.point());
            let directions = of_pixels((toward - origin).normalize(), [0.0; 2], 0.02 * random.unit());
            assert_packet_equals_singles(&bvh, origin, &directions, 16, ENDLESS);
        }
    }
}

#[test]
fn a_packet_along_an_axis_hits_what_single_rays_hit() {
    let mut random = Random(27);
    let bvh = build(&soup(&mut random, 300, 0.1, 1.0));
    for packet in 0..1000 {
        let (axis, sign) = (random.below(3), if random.unit() < 0.5 { -1.0 } else { 1.0 });
        let origin = (random.point() * 4.0).round() / 4.0;
        let step = [0.0, 0.01, 0.25][packet % 3];
        let directions = std::array::from_fn(|i| {
            let mut direction = Vec3::splat(0.0);
            direction[axis] = sign;
            direction[(axis + 1) % 3] = (i % 4) as f32 * step;
            direction[(axis + 2) % 3] = (i / 4) as f32 * step;
            direction
        });
        assert_packet_equals_singles(&bvh, origin, &directions, 16, ENDLESS);
    }
}

#[test]
fn rays_of_a_packet_that_are_none_hit_nothing() {
    let bvh = build(&soup(&mut Random(42), 100, 1.0, 1.0));
    let mut directions = [Vec3::new(0.3, 0.2, 1.0); 16];
    let bad = [Vec3::NAN, Vec3::INFINITY, Vec3::ZERO, Vec3::new(f32::NAN, 1.0, 0.0), Vec3::splat(1e-42)];
    directions[3..8].copy_from_slice(&bad);
    directions[8] = -directions[0];
    let origin = Vec3::new(0.1, -0.2, -0.3);
    assert!(assert_packet_equals_singles(&bvh, origin, &directions, 16, ENDLESS) > 0);
    let mut t_max = [f32::INFINITY; 16];
    t_max[..5].copy_from_slice(&[f32::NAN, -1.0, 0.0, f32::MIN_POSITIVE, f32::MAX]);
    for t_min in [0.0, -3.0, 0.5, f32::NAN, f32::INFINITY] {
        assert_packet_equals_singles(&bvh, origin, &directions, 16, (t_min, t_max));
    }
    for nowhere in [Vec3::NAN, Vec3::INFINITY] {
        assert_eq!(bvh.closest16(nowhere, &directions, 16, 0.0, &ENDLESS.1), [None; 16]);
    }
    assert_eq!(bvh.closest16(origin, &directions, 0, 0.0, &ENDLESS.1), [None; 16]);
    assert_packet_equals_singles(&build(&[]), origin, &directions, 16, ENDLESS);
}

/// A closed box whose sides are grids of jittered points.
struct ClosedBox {
    triangles: Vec<[Vec3; 3]>,
}

impl ClosedBox {
    fn new(random: &mut Random, n: usize, jitter: f32, rotation: Quat) -> ClosedBox {
        let mut triangles = Vec::new();
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                let inner: Vec<f32> = (0..(n + 1) * (n + 1) * 3).map(|_| (random.unit() - 0.5) * jitter).collect();
                let point = |i: usize, j: usize| {
                    let at = |k: usize| k as f32 * 2.0 / n as f32 - 1.0;
                    let mut point = Vec3::splat(side);
                    (point[(axis + 1) % 3], point[(axis + 2) % 3]) = (at(i), at(j));
                    if (1..n).contains(&i) && (1..n).contains(&j) {
                        point += Vec3::from_slice(&inner[(i * (n + 1) + j) * 3..][..3]);
                    }
                    rotation * point
                };
                for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                    let corners = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
                    triangles.push([corners[0], corners[1], corners[2]]);
                    triangles.push([corners[0], corners[2], corners[3]]);
                }
            }
        }
        ClosedBox { triangles }
    }

    /// A point on an edge or at a corner of some triangle.
    fn seam(&self, random: &mut Random) -> Vec3 {
        let triangle = self.triangles[random.below(self.triangles.len())];
        let (from, to) = (triangle[random.below(3)], triangle[random.below(3)]);
        from.lerp(to, random.unit())
    }
}

#[test]
fn no_ray_leaves_a_closed_box() {
    let mut random = Random(31);
    for (n, jitter, rotation) in
        [(1, 0.0, Quat::IDENTITY), (24, 0.02, Quat::from_rotation_x(0.7) * Quat::from_rotation_y(0.3))]
    {
        let closed = ClosedBox::new(&mut random, n, jitter, rotation);
        let bvh = build(&closed.triangles);
        let mut leaks = [0; 3];
        for _ in 0..15_000 {
            let origin = random.point() * 0.5;
            let targets = [0; 16].map(|_| closed.seam(&mut random));
            for target in targets {
                let ray = endless(origin, target - origin);
                leaks[0] += usize::from(bvh.closest(&ray).is_none());
                leaks[1] += usize::from(!bvh.occluded(&ray));
            }
            leaks[2] += bvh.visible16(origin, &targets, 16, 0.0, 1.5).count_ones() as usize;
        }
        for _ in 0..100_000 {
            leaks[0] += usize::from(bvh.closest(&endless(random.point() * 0.5, random.point())).is_none());
        }
        assert_eq!(leaks, [0; 3], "closest, occluded, fan; {n} × {n} a side");
    }
}

#[test]
fn an_empty_scene_is_never_hit() {
    let bvh = build(&[]);
    assert_eq!(bvh.closest(&endless(Vec3::ZERO, Vec3::X)), None);
    assert!(!bvh.occluded(&endless(Vec3::ZERO, Vec3::X)));
    assert_eq!(bvh.visible16(Vec3::ZERO, &[Vec3::ONE; 16], 16, 0.0, 1.0), u16::MAX);
    assert_eq!((bvh.n_triangles(), bvh.bounds()), (0, super::Aabb::EMPTY));
}

#[test]
fn triangles_that_cannot_be_hit_are_left_out() {
    let [a, b, c] = [Vec3::new(0.1, 0.1, 0.1), Vec3::new(0.7, 0.3, 0.1), Vec3::new(0.2, 0.9, 0.1)];
    let triangles = [
        [a, a, b],
        [a, b, c],
        [a, b, a.lerp(b, 0.5)],
        [a, b, Vec3::NAN],
        [a, Vec3::new(f32::INFINITY, 0.0, 0.0), c],
        [a, b, Vec3::splat(1e30)],
    ];
    let bvh = Bvh::build(&triangles, &[10, 20, 30, 40, 50, 60]);
    let hit = bvh.closest(&endless((a + b + c) / 3.0 + Vec3::Z, -Vec3::Z)).expect("the triangle below");
    assert_eq!((hit.triangle, bvh.bounds().max), (20, Vec3::new(0.7, 0.9, 0.1)));
    assert!((hit.t - 1.0).abs() < 1e-6 && (hit.u - 1.0 / 3.0).abs() < 1e-6 && (hit.v - 1.0 / 3.0).abs() < 1e-6);
    assert!(bvh.n_triangles() <= 2, "{} left", bvh.n_triangles());
}

#[test]
fn rays_that_are_none_hit_nothing() {
    let bvh = build(&soup(&mut Random(41), 100, 1.0, 1.0));
    for bad in [Vec3::NAN, Vec3::INFINITY, Vec3::ZERO, Vec3::new(f32::NAN, 1.0, 0.0), Vec3::splat(1e-42)] {
        assert_eq!(bvh.closest(&endless(Vec3::ZERO, bad)), None, "direction {bad}");
        assert!(!bvh.occluded(&endless(Vec3::ZERO, bad)), "direction {bad}");
    }
    let empty = Ray { t_max: f32::NAN, ..endless(Vec3::splat(-2.0), Vec3::ONE) };
    assert_eq!((bvh.closest(&empty), bvh.occluded(&empty)), (None, false));
}

#[test]
fn the_interval_of_a_ray_is_open() {
    let wall = [Vec3::new(-1.0, -1.0, 2.0), Vec3::new(3.0, -1.0, 2.0), Vec3::new(-1.0, 3.0, 2.0)];
    let bvh = build(&[wall]);
    let hits = |t_min, t_max| bvh.occluded(&Ray { t_min, t_max, ..endless(Vec3::ZERO, Vec3::Z) });
    assert!(hits(0.0, f32::INFINITY) && hits(1.999, 2.001) && hits(-5.0, 2.001));
    assert!(!hits(0.0, 2.0) && !hits(2.0, 3.0));
}

#[test]
fn of_coincident_triangles_the_smallest_id_is_hit_however_deep_the_tree() {
    let mut random = Random(51);
    let triangle = soup(&mut random, 1, 1.0, 1.0)[0];
    let center = (triangle[0] + triangle[1] + triangle[2]) / 3.0;
    for n in [21, 1000] {
        let bvh = Bvh::build(&vec![triangle; n], &(0..n).map(|i| ((i * 13 + 5) % n) as u32).collect::<Vec<_>>());
        let origin = random.point() * 3.0;
        assert_eq!(bvh.closest(&endless(origin, center - origin)).map(|hit| hit.triangle), Some(0));
        assert_fan_equals_singles(&bvh, origin, &[0; 16].map(|_| center + random.point() * 2.0), 16);
        // The builder ties: its tree of a thousand needs more entries than the stack has at hand.
        assert_eq!(bvh.tree.depth > 31, n == 1000, "{} levels for {n}", bvh.tree.depth);
    }
}

#[test]
fn thousands_of_coincident_triangles_do_not_make_a_chain() {
    let mut random = Random(52);
    for scale in [1.0, 1e6] {
        let mut triangles = vec![soup(&mut random, 1, 1.0, scale)[0]; 20_000];
        let center = (triangles[0][0] + triangles[0][1] + triangles[0][2]) / 3.0;
        let above = Vec3::Y * 100.0 * scale;
        triangles.extend(soup(&mut random, 50, 0.1, scale).into_iter().map(|far| far.map(|corner| corner + above)));
        let bvh = build(&triangles);
        for _ in 0..20 {
            let origin = random.point() * 3.0 * scale;
            let hit = bvh.closest(&endless(origin, center - origin)).expect("its center is not to be missed");
            assert!(hit.triangle == 0 && (hit.t - 1.0).abs() < 1e-3, "{hit:?}");
        }
        assert!(bvh.tree.depth < 250, "{} levels", bvh.tree.depth);
    }
}

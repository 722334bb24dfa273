use std::f32::consts::{PI, TAU};
use std::fmt::Write;

use glam::Vec3;

use super::*;
use crate::lamps::lattice;
use crate::laws::at_hand;
use crate::sampler::uniform_sphere;

const X: Vec3 = Vec3::X;
const Y: Vec3 = Vec3::Y;
const AIM: Vec3 = Vec3::NEG_Z;

/// An LM-63 file of a type with a row of intensities per horizontal angle; line 5 has the counts, 7 the first angles.
fn ies(photometry: u32, vertical: &[f64], horizontal: &[f64], candela: &[f64]) -> String {
    let words = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let (n_vertical, n_horizontal) = (vertical.len(), horizontal.len());
    let mut text = "IESNA:LM-63-2002\r\n[TEST] by hand\r\n[MANUFAC] nobody\r\nTILT=NONE\r\n".to_owned();
    write!(text, "1 1000 1.0 {n_vertical} {n_horizontal} {photometry} 2 0 0 0\r\n1.0 1.0 10\r\n").unwrap();
    write!(text, "{}\r\n{}\r\n", words(vertical), words(horizontal)).unwrap();
    for row in candela.chunks(n_vertical) {
        write!(text, "{}\r\n", words(row)).unwrap();
    }
    text
}

/// A EULUMDAT file of four planes, three angles, 500 lm, factor 2: intensities in the file are candela.
fn ldt(isym: u32, candela: &[f64]) -> String {
    let mut lines = vec![String::from("0"); 42];
    for (number, value) in [(3, isym), (4, 4), (6, 3), (24, 2), (26, 1), (27, 1), (29, 500)] {
        lines[number - 1] = value.to_string();
    }
    lines[1] = "nobody's lamp, 5".into();
    lines.extend(["0", "90", "180", "270", "0", "90", "180"].map(String::from));
    lines.extend(candela.iter().map(|value| value.to_string().replace('.', ",")));
    lines.join("\n")
}

fn parsed(text: &str) -> PhotometricProfile {
    let name = if text.contains("TILT") { "test.ies" } else { "test.ldt" };
    PhotometricProfile::parse(text.as_bytes(), name).expect("a valid file")
}

fn expect(profile: &PhotometricProfile, known: &[(Vec3, f32)]) {
    for &(direction, candela) in known {
        let got = profile.candela(direction);
        assert!((got - candela).abs() <= 1e-3 * candela.max(1.0), "towards {direction}: {got}, not {candela}");
    }
}

/// One plane's three intensities: 7 at the aim, 5 behind, and what lies between at 90°.
fn ring(values: &[f64]) -> Vec<f64> {
    values.iter().flat_map(|&value| [7.0, value, 5.0]).collect()
}

#[test]
fn type_c_planes_turn_from_x_to_y_and_complete_themselves() {
    let at = |horizontal: &[f64], values: &[f64]| parsed(&ies(1, &[0.0, 90.0, 180.0], horizontal, &ring(values)));
    let one = at(&[0.0], &[100.0]);
    expect(
        &one,
        &[(AIM, 7.0), (-AIM, 5.0), (X, 100.0), (Y, 100.0), (-X - Y, 100.0), (X + AIM, 53.5), (9.0 * Y, 100.0)],
    );
    let quadrant = at(&[0.0, 45.0, 90.0], &[100.0, 200.0, 300.0]);
    expect(&quadrant, &[(X, 100.0), (-X, 100.0), (Y, 300.0), (-Y, 300.0)]);
    expect(&quadrant, &[(X + Y, 200.0), (Y - X, 200.0), (-X - Y, 200.0), (X - Y, 200.0)]);
    let eighth = PI / 8.0;
    expect(&quadrant, &[(Vec3::new(eighth.cos(), -eighth.sin(), 0.0), 150.0)]);
    let half = at(&[0.0, 90.0, 180.0], &[100.0, 200.0, 300.0]);
    expect(&half, &[(X, 100.0), (Y, 200.0), (-Y, 200.0), (-X, 300.0), (-X - Y, 250.0)]);
    let other_half = at(&[90.0, 180.0, 270.0], &[100.0, 200.0, 300.0]);
    expect(&other_half, &[(Y, 100.0), (-X, 200.0), (X, 200.0), (-Y, 300.0), (X - Y, 250.0)]);
    for (planes, values) in [(5, [100.0, 200.0, 300.0, 400.0, 100.0]), (4, [100.0, 200.0, 300.0, 400.0, 0.0])] {
        let all = at(&[0.0, 90.0, 180.0, 270.0, 360.0][..planes], &values[..planes]);
        expect(&all, &[(X, 100.0), (Y, 200.0), (-X, 300.0), (-Y, 400.0), (X - Y, 250.0), (X + Y, 150.0)]);
    }
}

#[test]
fn a_device_gets_all_angles_and_shares_of_the_largest_intensity() {
    let half = parsed(&ies(1, &[0.0, 90.0], &[0.0, 180.0], &[100.0, 50.0, 100.0, 200.0]));
    let (counts, numbers) = half.words();
    assert_eq!(counts, [2, 3, 0]);
    assert_eq!(numbers, [0.0, 0.5 * PI, 0.0, PI, TAU, 0.5, 0.25, 0.5, 1.0, 0.5, 0.25]);
    let across = parsed(&ies(2, &[-90.0, 90.0], &[-90.0, 0.0, 90.0], &[1.0, 2.0, 1.0, 4.0, 1.0, 2.0]));
    assert_eq!(across.words().0, [2, 3, 1]);
}

#[test]
fn type_b_planes_meet_in_y_and_turn_towards_x() {
    let full = [1.0, 10.0, 2.0, 1.0, 20.0, 2.0, 1.0, 30.0, 2.0];
    let profile = parsed(&ies(2, &[-90.0, 0.0, 90.0], &[-90.0, 0.0, 90.0], &full));
    expect(&profile, &[(AIM, 20.0), (-Y, 30.0), (Y, 10.0), (X, 2.0), (-X, 1.0), (AIM - Y, 25.0), (AIM + X, 11.0)]);
    expect(&profile, &[(-AIM, 0.0), (-AIM + Y, 0.0)]);
    let mirrored = parsed(&ies(2, &[0.0, 90.0], &[0.0, 90.0], &[20.0, 2.0, 30.0, 2.0]));
    expect(&mirrored, &[(AIM, 20.0), (-Y, 30.0), (Y, 30.0), (X, 2.0), (-X, 2.0), (AIM - X, 11.0), (-AIM, 0.0)]);
}

#[test]
fn the_corners_of_a_type_b_file_lie_where_its_axis_across_has_them() {
    let degrees = [-90.0, 30.0, 60.0, 90.0];
    let candela: Vec<f64> = (0..16).map(f64::from).collect();
    let profile = parsed(&ies(2, &degrees, &degrees, &candela));
    let root3 = 3.0_f32.sqrt();
    // Row H = 60°, columns V = 60° and 30°; row H = 30°, column V = 60°.
    expect(
        &profile,
        &[
            (Vec3::new(root3 / 4.0, -root3 / 2.0, -0.25), 10.0),
            (Vec3::new(0.25, -root3 / 2.0, -root3 / 4.0), 9.0),
            (Vec3::new(0.75, -0.5, -root3 / 4.0), 6.0),
        ],
    );
}

#[test]
fn rays_carry_the_light_of_a_profile_where_it_sends_it() {
    let number = |nth: u32| f64::from(100 + nth * 37 % 90);
    let candela = |n: u32| (0..n).map(number).collect::<Vec<_>>();
    let c = ies(1, &[0.0, 30.0, 90.0, 180.0], &[0.0, 90.0, 180.0, 270.0], &candela(16));
    let b = ies(2, &[-90.0, 0.0, 60.0], &[-90.0, -20.0, 90.0], &candela(9));
    let place = |nth: u32| lattice(nth).to_array();
    for profile in [parsed(&c), parsed(&b)] {
        let rays: Vec<(Vec3, f32)> = profile.rays(4096, place);
        let all: f32 = rays.iter().map(|(_, flux)| flux * profile.max_candela()).sum();
        assert!((all / profile.flux_lm() - 1.0).abs() < 0.01, "{all} of {} lm", profile.flux_lm());
        let n = 1 << 15;
        for axis in [X, Y, AIM] {
            let ahead = rays.iter().filter(|(direction, _)| direction.dot(axis) > 0.0);
            let found = ahead.map(|(_, flux)| flux * profile.max_candela()).sum::<f32>();
            let sphere = (0..n).map(|nth| uniform_sphere(place(nth))).filter(|direction| direction.dot(axis) > 0.0);
            let expected = sphere.map(|direction| profile.candela(direction)).sum::<f32>() * 4.0 * PI / n as f32;
            assert!((found / expected - 1.0).abs() < 0.02, "towards {axis}: {found} lm, not {expected}");
        }
    }
}

#[test]
fn lines_may_end_as_any_system_has_them() {
    let text = ies(1, &[0.0, 90.0], &[0.0], &[100.0, 50.0]);
    let known = parsed(&text);
    for end in ["\n", "\r", "\r\r\n"] {
        assert_eq!(parsed(&text.replace("\r\n", end)), known, "{end:?}");
    }
    let broken = text.replace("1000 1.0", "1000 0").replace("\r\n", "\r");
    let words = PhotometricProfile::parse(broken.as_bytes(), "a.ies").expect_err("a multiplier of 0").to_string();
    assert!(words.starts_with("line 5 of"), "{words}");
    let counted = ldt(4, &[9.0; 6]);
    assert_eq!(parsed(&counted.replace('\n', "\r\r\n")), parsed(&counted));
}

#[test]
fn commas_are_decimal_points_where_only_so_a_file_holds_what_it_announces() {
    let dotted = ies(1, &[0.0, 45.0, 90.0], &[0.0], &[100.5, 50.25, 7.0]).replace("1.0 1.0 10", "1.0 1.0 10.5");
    let plain_head = dotted.replace("1000 1.0", "1000 1").replace("1.0 1.0 10.5", "1 1 10");
    for text in [dotted, plain_head] {
        let known = parsed(&text);
        expect(&known, &[(AIM, 100.5), (X, 7.0), (X + AIM, 50.25)]);
        assert!(known.remarks().is_empty(), "{:?}", known.remarks());
        let (head, numbers) = text.split_once("TILT=NONE").expect("a head");
        let commas = parsed(&format!("{head}TILT=NONE{}", numbers.replace('.', ",")));
        assert_eq!((commas.light_bytes(), commas.watts()), (known.light_bytes(), known.watts()));
        assert!(matches!(commas.remarks(), [one] if one.contains("commas")), "{:?}", commas.remarks());
        assert_eq!(parsed(&format!("{head}TILT=NONE{}", numbers.replace(' ', ","))), known);
        let more = parsed(&format!("{text}3 4\r\n"));
        assert_eq!(more.light_bytes(), known.light_bytes());
        assert!(matches!(more.remarks(), [one] if one.starts_with("2 numbers")), "{:?}", more.remarks());
    }
}

#[test]
fn decimal_commas_are_read_before_a_text_with_numbers() {
    let dotted = ies(1, &[0.0, 45.0, 90.0], &[0.0], &[100.5, 50.25, 7.0]);
    let (head, numbers) = dotted.split_once("TILT=NONE").expect("a head");
    let commas = format!("{head}TILT=NONE{}measured in 2019, page 3\r\n", numbers.replace('.', ","));
    let read = parsed(&commas);
    assert_eq!(read.light_bytes(), parsed(&dotted).light_bytes());
    let told = read.remarks();
    assert!(matches!(told, [left, commas] if left.starts_with("2 numbers") && commas.contains("commas")), "{told:?}");
}

#[test]
fn eulumdat_planes_complete_themselves() {
    let full = parsed(&ldt(0, &ring(&[100.0, 200.0, 300.0, 400.0])));
    expect(&full, &[(AIM, 7.0), (X, 100.0), (Y, 200.0), (-X, 300.0), (-Y, 400.0), (X - Y, 250.0)]);
    let round = parsed(&ldt(1, &ring(&[100.5])));
    expect(&round, &[(X, 100.5), (-Y, 100.5), (-AIM, 5.0)]);
    let about_c0 = parsed(&ldt(2, &ring(&[100.0, 200.0, 300.0])));
    expect(&about_c0, &[(X, 100.0), (Y, 200.0), (-Y, 200.0), (-X, 300.0)]);
    let about_c90 = parsed(&ldt(3, &ring(&[100.0, 200.0, 300.0])));
    expect(&about_c90, &[(-Y, 100.0), (X, 200.0), (-X, 200.0), (Y, 300.0), (X + Y, 250.0)]);
    let quadrant = parsed(&ldt(4, &ring(&[100.0, 200.0])));
    expect(&quadrant, &[(X, 100.0), (-X, 100.0), (Y, 200.0), (-Y, 200.0), (X + AIM, 53.5)]);
}

#[test]
fn factors_of_the_file_scale_intensities() {
    let plain = ies(1, &[0.0, 90.0], &[0.0], &[100.0, 100.0]);
    let scaled = plain.replace("1 1000 1.0 2", "1 1000 2.0 2").replace("1.0 1.0 10", "0.5 3.0 10");
    assert_eq!(parsed(&scaled).candela(AIM), 100.0, "the last factor is reserved since 2002");
    assert_eq!(parsed(&scaled.replace("2002", "1995")).candela(AIM), 300.0);
    let tilted = scaled.replace("TILT=NONE", "TILT=INCLUDE\r\n1\r\n2\r\n0, 90\r\n1.0 0.8");
    assert_eq!(parsed(&tilted).candela(AIM), 100.0);
    assert_eq!(parsed(&tilted[tilted.find("TILT").expect("a head")..]).max_candela(), 300.0, "1986 has no first line");
}

#[test]
fn tables_of_tilts_further_sets_of_lamps_and_planes_that_a_symmetry_leaves_out_are_told() {
    let plain = ies(1, &[0.0, 90.0], &[0.0], &[100.0, 50.0]);
    for (tilt, n_told) in [
        ("TILT=NONE", 0),
        ("TILT=INCLUDE\r\n1\r\n2\r\n0 90\r\n1 1", 0),
        ("TILT=INCLUDE\r\n1\r\n2\r\n0 90\r\n1 0.8", 1),
        ("TILT=lamp.tlt", 1),
    ] {
        let profile = parsed(&plain.replace("TILT=NONE", tilt));
        assert_eq!(profile.light_bytes(), parsed(&plain).light_bytes(), "{tilt}");
        let told = profile.remarks();
        assert!(told.len() == n_told && told.iter().all(|remark| remark.contains("tilted")), "{tilt}: {told:?}");
    }
    let round = ldt(1, &[9.0; 3]);
    assert!(parsed(&round).remarks().is_empty(), "{:?}", parsed(&round).remarks());
    let mut lines: Vec<&str> = round.lines().collect();
    lines[25] = "2";
    let second = ["1", "a stronger lamp", "900", "0", "0", "20"];
    let two = parsed(&[&lines[..32], &second[..], &lines[32..]].concat().join("\n"));
    assert_eq!(two.light_bytes(), parsed(&round).light_bytes());
    assert!(matches!(two.remarks(), [one] if one.contains("2 sets") && one.ends_with("500 lm")), "{:?}", two.remarks());
    let all = parsed(&ldt(1, &[9.0; 12]));
    assert!(matches!(all.remarks(), [one] if one.starts_with("9 numbers")), "{:?}", all.remarks());
}

#[test]
fn flux_of_known_distributions_is_known() {
    let near = |flux: f32, known: f32| assert!((flux - known).abs() < 2e-3 * known, "{flux} lm, not {known}");
    near(parsed(&ies(1, &[0.0, 90.0, 180.0], &[0.0, 90.0], &[9.0; 6])).flux_lm(), 2.0 * TAU * 9.0);
    near(parsed(&ies(2, &[-90.0, 0.0, 90.0], &[-90.0, 90.0], &[9.0; 6])).flux_lm(), TAU * 9.0);
    near(parsed(&ies(2, &[0.0, 90.0], &[0.0, 90.0], &[9.0; 4])).flux_lm(), TAU * 9.0);
    // 9 cd (1 − 2 |H| / π): its integral over V and H is π · 2 · 9 · ∫ (1 − 2 H / π) cos H dH = 4 · 9.
    near(parsed(&ies(2, &[0.0, 90.0], &[0.0, 90.0], &[9.0, 9.0, 0.0, 0.0])).flux_lm(), 36.0);
    let degrees: Vec<f64> = (0..=45).map(|i| 2.0 * f64::from(i)).collect();
    let cosine: Vec<f64> = degrees.iter().map(|degrees| 9.0 * degrees.to_radians().cos()).collect();
    near(parsed(&ies(1, &degrees, &[0.0], &cosine)).flux_lm(), 9.0 * PI);
    for (isym, planes) in [(0, 4), (1, 1), (2, 3), (3, 3), (4, 2)] {
        near(parsed(&ldt(isym, &[9.0; 12][..3 * planes])).flux_lm(), 2.0 * TAU * 9.0);
    }
}

/// Mean over a Fibonacci lattice of directions.
fn lattice_flux(profile: &PhotometricProfile) -> f32 {
    const N: usize = 200_000;
    let golden = PI * (3.0 - 5.0_f32.sqrt());
    let candela = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f32 / N as f32;
        let (sin, cos) = ((i as f64 * f64::from(golden)) % std::f64::consts::TAU).sin_cos();
        let across = (1.0 - z * z).sqrt();
        f64::from(profile.candela(Vec3::new(across * cos as f32, across * sin as f32, z)))
    };
    ((0..N).map(candela).sum::<f64>() / N as f64) as f32 * 2.0 * TAU
}

#[test]
fn flux_is_the_integral_of_candela() {
    let values: Vec<f64> = (0..20).map(|i| f64::from(i * i % 13)).collect();
    for profile in [
        parsed(&ies(1, &[0.0, 30.0, 70.0, 120.0], &[0.0, 20.0, 100.0, 190.0, 350.0], &values)),
        parsed(&ies(1, &[20.0, 30.0, 70.0, 180.0], &[90.0, 120.0, 180.0, 250.0, 270.0], &values)),
        parsed(&ies(2, &[-90.0, -20.0, 35.0, 90.0], &[-80.0, -10.0, 5.0, 50.0, 90.0], &values)),
    ] {
        let (sum, exact) = (lattice_flux(&profile), profile.flux_lm());
        assert!((sum - exact).abs() < 2e-3 * exact, "{sum} lm by sum, {exact} lm by formula");
    }
}

#[test]
fn faults_are_named_with_their_lines() {
    let good = ies(1, &[0.0, 45.0, 90.0], &[0.0, 90.0], &[9.0; 6]);
    let good_ldt = ldt(4, &[9.0; 6]);
    for (from, to, line, reason) in [
        ("3 2 1 2 0", "3 2 3 2 0", 5, "type A"),
        ("3 2 1 2 0", "3 2 4 2 0", 5, "type of photometry is 4"),
        ("3 2 1 2 0", "4000000000 2 1 2 0", 5, "number of vertical angles is 4000000000"),
        ("3 2 1 2 0", "3 2.5 1 2 0", 5, "whole number"),
        ("3 2 1 2 0", "3 -2 1 2 0", 5, "number of horizontal angles is -2"),
        ("3 2 1 2 0", "1999 1999 1 2 0", 5, "more than can be read"),
        ("1000 1.0", "1000 0", 5, "multiplier is 0"),
        ("1.0 1.0 10", "-1 1.0 10", 6, "ballast factor is -1"),
        ("0 45 90", "0 45 40", 7, "not larger"),
        ("0 45 90", "0 45 190", 7, "190° is not within"),
        ("0 45 90", "0 NaN 90", 7, "\"NaN\" is no number"),
        ("0 90\r\n", "0 80\r\n", 8, "from 0° to 80°"),
        ("9 9 9\r\n9 9 9\r\n", "9 9 9\r\n9 -9 9\r\n", 10, "intensity -9"),
        ("9 9 9\r\n9 9 9\r\n", "9 9 9\r\n9 inf 9\r\n", 10, "\"inf\" is no number"),
        ("9 9 9\r\n9 9 9\r\n", "9 9 9\r\n9 1e300 9\r\n", 10, "not possible"),
        ("9 9 9\r\n9 9 9\r\n", "9 9 9\r\n9\r\n", 10, "intensity 5 of 6 is missing"),
    ] {
        assert!(good.contains(from), "{from:?}");
        let error = PhotometricProfile::parse(good.replace(from, to).as_bytes(), "a.ies").expect_err(to);
        let words = error.to_string();
        assert!(words.starts_with(&format!("line {line} of a.ies: ")) && words.contains(reason), "{words}");
    }
    let lines: Vec<&str> = good_ldt.lines().collect();
    for (line, to, reason) in [
        (3, "5", "symmetry is 5"),
        (4, "6", "multiple of 4"),
        (24, "-2", "conversion factor"),
        (29, "-500", "luminous flux"),
        (26, "", "sets of lamps is missing"),
        (51, "-1", "intensity -1"),
    ] {
        let mut lines = lines.clone();
        lines[line - 1] = to;
        let mut text = lines.join("\n");
        if line == 4 {
            text = text.replacen("\n180\n270\n", "\n180\n270\n280\n290\n", 1);
        }
        let words = PhotometricProfile::parse(text.as_bytes(), "a.LDT").expect_err(reason).to_string();
        assert!(words.starts_with(&format!("line {line} of a.LDT: ")) && words.contains(reason), "{words}");
    }
    let dark = ies(1, &[0.0, 90.0], &[0.0], &[0.0, 0.0]);
    assert!(matches!(PhotometricProfile::parse(dark.as_bytes(), "a.ies"), Err(PhotometryError::Dark { .. })));
    assert!(matches!(PhotometricProfile::parse(b"hello", "a.txt"), Err(PhotometryError::UnknownFormat { .. })));
    assert!(PhotometricProfile::parse(b"", "a.ldt").is_err() && PhotometricProfile::parse(b"TILT=", "a.ies").is_err());
}

#[test]
fn noise_below_zero_and_angles_that_stand_there_twice_are_mended_and_told() {
    let noisy = parsed(&ies(1, &[0.0, 90.0, 180.0], &[0.0], &[50.0, -0.4, -0.01]));
    expect(&noisy, &[(AIM, 50.0), (X, 0.0), (-AIM, 0.0)]);
    assert!(matches!(noisy.remarks(), [one] if one.starts_with("2 intensities")), "{:?}", noisy.remarks());
    let known = parsed(&ies(1, &[0.0, 45.0, 90.0], &[0.0, 90.0], &[9.0, 5.0, 1.0, 9.0, 3.0, 2.0]));
    let twice = ies(
        1,
        &[0.0, 45.0, 45.0, 90.0],
        &[0.0, 0.0, 90.0],
        &[9.0, 5.0, 5.0, 1.0, 9.0, 5.0, 5.0, 1.0, 9.0, 3.0, 3.0, 2.0],
    );
    let mended = parsed(&twice);
    assert_eq!(mended.light_bytes(), known.light_bytes());
    assert!(matches!(mended.remarks(), [one] if one.starts_with("2 angles")), "{:?}", mended.remarks());
    for text in [ies(1, &[0.0, 45.0, 45.0], &[0.0], &[9.0, 5.0, 1.0]), ies(1, &[45.0, 45.0], &[0.0], &[9.0, 9.0])] {
        let why = PhotometricProfile::parse(text.as_bytes(), "a.ies").expect_err("no table").to_string();
        assert!(why.starts_with("line 8 of a.ies: "), "{why}");
    }
    let factors = |factor: &str| {
        let lines = ldt(1, &[9.0; 3]);
        let mut lines: Vec<&str> = lines.lines().collect();
        lines[23] = factor;
        parsed(&lines.join("\n"))
    };
    let unused = factors("0");
    assert_eq!(unused.light_bytes(), factors("1").light_bytes());
    assert!(matches!(unused.remarks(), [one] if one.contains("line 24")), "{:?}", unused.remarks());
}

#[test]
fn heads_are_read_as_people_type_them() {
    let text = ies(1, &[0.0, 90.0], &[0.0], &[100.0, 50.0]).replace("1.0 1.0 10", "1.0 0.5 10");
    let known = parsed(&text);
    expect(&known, &[(AIM, 100.0)]);
    for (from, to, candela) in [
        ("IESNA:LM-63-2002", "iesna:lm-63-2002", 100.0),
        ("IESNA:LM-63-2002", "\r\nIES:LM-63-2019", 100.0),
        ("IESNA:LM-63-2002", "IESNA:LM-63-1995", 50.0),
        ("IESNA:LM-63-2002", "[MORE] as in LM-63-2002", 50.0),
        ("TILT=NONE", " TILT = NONE", 100.0),
        ("TILT=NONE", "Tilt =include\r\n1\r\n2\r\n0 90\r\n1 1", 100.0),
    ] {
        assert!(text.contains(from));
        expect(&parsed_ies(&text.replace(from, to)), &[(AIM, candela)]);
    }
}

fn parsed_ies(text: &str) -> PhotometricProfile {
    PhotometricProfile::parse(text.as_bytes(), "test.ies").expect(text)
}

/// 64-bit linear congruential generator.
struct Dice(u64);

impl Dice {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n
    }
}

#[test]
fn the_power_of_a_file_is_that_of_its_first_set_of_lamps_and_0_is_none() {
    let plain = ies(1, &[0.0, 90.0], &[0.0], &[100.0, 100.0]);
    let watts = |text: &str| parsed(text).watts();
    assert_eq!(watts(&plain), Some(10.0));
    for (written, known) in [("36.5", Some(36.5)), ("0", None), ("-3", None), ("1e300", None)] {
        assert_eq!(watts(&plain.replace("1.0 1.0 10", &format!("1.0 1.0 {written}"))), known, "{written}");
    }
    let lines = ldt(1, &[9.0; 3]);
    let with = |written: &str| {
        let mut lines: Vec<&str> = lines.lines().collect();
        lines[31] = written;
        watts(&lines.join("\n"))
    };
    for (written, known) in [("58,5", Some(58.5)), ("0", None), ("unknown", None), ("", None)] {
        assert_eq!(with(written), known, "{written}");
    }
}

#[test]
fn damaged_files_never_panic() {
    let mut dice = Dice(7);
    let (all, some) = ([0.0, 45.0, 90.0, 180.0, 270.0], [1.0, 2.5, 30.0]);
    let files = [
        ies(1, &all[..4], &all, &some.repeat(7)[..20]),
        ies(2, &[-90.0, 0.0, 90.0], &[-90.0, 90.0], &some.repeat(2)).replace("NONE", "INCLUDE\n1 1 0 1"),
        ldt(0, &some.repeat(4)),
        ldt(3, &some.repeat(3)),
    ];
    let mut n_read = 0;
    for nth in 0..4000 {
        let mut bytes = files[nth % files.len()].clone().into_bytes();
        if dice.below(3) == 0 {
            bytes.truncate(dice.below(bytes.len()));
        }
        for _ in 0..dice.below(4) {
            let at = dice.below(bytes.len().max(1));
            let other = [b'-', b'9', b' ', b'\n', b'.', b'e', 0xFF, dice.below(256) as u8][dice.below(8)];
            if let Some(byte) = bytes.get_mut(at) {
                *byte = other;
            }
        }
        if let Ok(profile) = PhotometricProfile::parse(&bytes, ["a.ies", "a.ldt"][nth / 2 % 2]) {
            n_read += 1;
            let direction =
                Vec3::new(dice.below(9) as f32 - 4.0, dice.below(9) as f32 - 4.0, dice.below(9) as f32 - 4.0);
            let candela = profile.candela(direction);
            assert!((0.0..=profile.max_candela()).contains(&candela), "file {nth}: {candela} cd");
            assert!(profile.flux_lm() >= 0.0, "file {nth}");
        }
    }
    assert!(n_read > 200, "{n_read} of 4000 were read");
}

#[test]
fn files_of_a_maker_hold_what_they_state() {
    let Some(folder) = at_hand::folder() else { return };
    let load = |name: &str| {
        let bytes = std::fs::read(folder.join("env").join(name)).expect(name);
        PhotometricProfile::parse(&bytes, name).expect(name)
    };
    let towards = |gamma: f32, phi: f32| {
        let ((sin, cos), (y, x)) = (gamma.to_radians().sin_cos(), phi.to_radians().sin_cos());
        Vec3::new(sin * x, sin * y, -cos)
    };
    let narrow = load("bega-50975.6K3.ies");
    assert_eq!([narrow.watts(), load("bega-50899.2K3.ies").watts()], [Some(9.0), Some(14.0)]);
    expect(&narrow, &[(AIM, 330.8), (towards(25.0, 200.0), 238.1), (towards(41.25, 10.0), 34.5), (-AIM, 0.0)]);
    assert_eq!(narrow.max_candela(), 337.2);
    assert!((narrow.flux_lm() / 321.0 - 1.0).abs() < 0.03, "{} lm of 321", narrow.flux_lm());
    let wide = load("bega-50899.2K3.ies");
    expect(&wide, &[(AIM, 2160.3), (towards(20.0, 352.0), 882.7), (towards(85.0, 345.0), 1.7), (X, 0.0), (-AIM, 0.0)]);
    assert!((wide.flux_lm() / 1221.0 - 1.0).abs() < 0.03, "{} lm of 1221", wide.flux_lm());
}

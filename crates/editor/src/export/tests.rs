//! What is written comes back: values, layers, windows, depth and words about color.

use ::exr::prelude::{AttributeValue, FlatSamples, ReadChannels, ReadLayers, Text, Vec2};
use clerestory_relight::display::{encode16, turbo_bytes};
use clerestory_relight::{DisplayParams, encode};

use super::options::{ExrCompression, ExrSamples, PngDepth, Region};
use super::*;
use crate::compare::read_exr;
use crate::isolux::Isolux;
use crate::look::FalseColor;

fn gradient(scale: f32) -> Radiance {
    let pixels = (0..12).map(|i| [i as f32 * scale, 1.0 * scale, 0.25 * scale]).collect();
    Radiance { width: 4, height: 3, pixels }
}

#[test]
fn an_exr_gives_back_every_bit_and_carries_look_and_layers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let (whole, a, b) = (gradient(1.0), gradient(0.25), gradient(0.75));
    let layers = [LightLayer { key: "a.b".into(), radiance: a }, LightLayer { key: "ä_b".into(), radiance: b }];
    let look = Look::default();
    Picture { radiance: &whole, layers: &layers, irradiance: None, look: &look, units: Units::Photometric }
        .save(&path, &ExportOptions::default())
        .unwrap();
    assert_eq!(read_exr(&path).unwrap(), whole);

    let meta = ::exr::meta::MetaData::read_from_file(&path, true).unwrap();
    let header = &meta.headers[0];
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    assert!(names.contains(&"a_b.R".to_string()), "{names:?}");
    let attribute = &header.own_attributes.other[&Text::from("clerestory.look")];
    let AttributeValue::Text(json) = attribute else { panic!("the look is a text") };
    assert_eq!(Look::from_json(&json.to_string()).unwrap().0, look);
}

#[test]
fn a_light_without_a_name_has_a_layer_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let (whole, look) = (gradient(1.0), Look::default());
    let layers = ["", "b"].map(|key| LightLayer { key: key.into(), radiance: gradient(0.5) });
    Picture { radiance: &whole, layers: &layers, irradiance: None, look: &look, units: Units::Photometric }
        .save(&path, &ExportOptions::default())
        .unwrap();
    let meta = ::exr::meta::MetaData::read_from_file(&path, true).unwrap();
    let names: Vec<String> = meta.headers[0].channels.list.iter().map(|c| c.name.to_string()).collect();
    assert_eq!(names, ["B", "G", "R", "_.B", "_.G", "_.R", "b.B", "b.G", "b.R"]);
    assert_eq!(read_exr(&path).unwrap(), whole);
}

#[test]
fn a_layer_that_is_called_otherwise_is_told() {
    let (whole, look) = (gradient(1.0), Look::default());
    let layers =
        ["a.b", "a_b", "c.d", "irradiance"].map(|key| LightLayer { key: key.into(), radiance: gradient(0.25) });
    let told = |irradiance: Option<&Radiance>| {
        let picture = Picture { radiance: &whole, layers: &layers, irradiance, look: &look, units: Units::Photometric };
        picture.layer_remarks()
    };
    let (alone, with_lux) = (told(None), told(Some(&whole)));
    assert!(alone.len() == 1 && alone[0].contains("`a.b` is called `a_b#2`"), "{alone:?}");
    assert!(with_lux.len() == 2 && with_lux[1].contains("`irradiance` is called `irradiance#2`"), "{with_lux:?}");
}

#[test]
fn the_same_picture_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let paths = ["a.exr", "b.exr"].map(|name| folder.path().join(name));
    for path in &paths {
        Picture {
            radiance: &gradient(1.0),
            layers: &[],
            irradiance: None,
            look: &Look::default(),
            units: Units::Photometric,
        }
        .save(path, &ExportOptions::default())
        .unwrap();
    }
    assert!(std::fs::read(&paths[0]).unwrap() == std::fs::read(&paths[1]).unwrap());
}

#[test]
fn a_png_is_what_the_display_shows_and_says_srgb() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let radiance = gradient(1.0);
    let shown = Picture {
        radiance: &radiance,
        layers: &[],
        irradiance: None,
        look: &Look::default(),
        units: Units::Photometric,
    }
    .save(&path, &ExportOptions::default())
    .unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(&bytes[37..41], b"sRGB");
    let expected = encode(&radiance, &DisplayParams { exposure_ev: shown.exposure_ev, ..DisplayParams::default() });
    let decoded = image::load_from_memory(&bytes).unwrap().to_rgba8();
    assert_eq!(decoded.dimensions(), (4, 3));
    assert_eq!(decoded.into_raw(), expected);
}

#[test]
fn false_color_of_illuminance_shows_irradiance_with_a_legend_or_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let mut look = Look::default();
    let range = Some([1.0, 100.0]);
    look.display.false_color = Some(FalseColor { quantity: Quantity::Illuminance, range, ..FalseColor::default() });
    let (radiance, lux) = (gradient(1.0), Radiance { width: 4, height: 3, pixels: vec![[10.0; 3]; 12] });
    let picture =
        Picture { radiance: &radiance, layers: &[], irradiance: None, look: &look, units: Units::Photometric };
    let error = picture.save(&path, &ExportOptions::default()).unwrap_err().to_string();
    assert!(error.contains("--irradiance") && !path.exists(), "{error}");

    let shown = Picture { irradiance: Some(&lux), ..picture }.save(&path, &ExportOptions::default()).unwrap();
    assert_eq!(shown.legend.unwrap().json()["high"], 100.0);
    let png = image::open(&path).unwrap().to_rgb8();
    assert_eq!(png.get_pixel(2, 1).0, turbo_bytes(0.5), "10 lies halfway from 1 to 100");
    assert!(png.width() > 4 + 8 && png.height() >= 48, "the legend is beside the picture");
    assert_eq!(shown.size_px, [png.width(), png.height()], "and is told");
    assert_eq!(shown.legend.unwrap().unit(), "lx");
    let exr = folder.path().join("a.exr");
    assert_eq!(picture.save(&exr, &ExportOptions::default()).unwrap().legend, None);
    assert_eq!(read_exr(&exr).unwrap(), radiance, "an EXR stays linear");
}

#[test]
fn luminance_that_was_taken_by_a_camera_has_no_unit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let mut look = Look::default();
    look.display.false_color = Some(FalseColor::default());
    let radiance = gradient(1.0);
    for (units, unit) in [(Units::Photometric, "cd/m²"), (Units::Relative, "relative")] {
        let picture = Picture { radiance: &radiance, layers: &[], irradiance: None, look: &look, units };
        let legend = picture.save(&path, &ExportOptions::default()).unwrap().legend.unwrap();
        assert_eq!(legend.unit(), unit);
        assert_eq!(legend.json()["unit"], unit);
    }
}

#[test]
fn isolux_lines_lie_over_false_color_where_the_light_is_at_either_depth() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let mut look = Look::default();
    let colors = FalseColor { quantity: Quantity::Illuminance, range: Some([10.0, 1000.0]), ..FalseColor::default() };
    // 95 lx on the left to 105 lx on the right: 100 lx are in the middle, from top to bottom.
    let lux = |nth: u32| [95.0 + 10.0 * ((nth % 100) as f32 + 0.5) / 100.0; 3];
    let lux = Radiance { width: 100, height: 120, pixels: (0..12_000).map(lux).collect() };
    for depth in [PngDepth::Eight, PngDepth::Sixteen] {
        let mut shown = |isolux: Isolux| {
            look.display.false_color = Some(FalseColor { isolux, ..colors });
            let picture =
                Picture { radiance: &lux, layers: &[], irradiance: Some(&lux), look: &look, units: Units::Photometric };
            let options = ExportOptions { depth, ..ExportOptions::default() };
            assert_eq!(picture.save(&path, &options).unwrap().legend.unwrap().json()["isolux"], isolux.name());
            image::open(&path).unwrap().to_rgb8()
        };
        let (plain, lined) = (shown(Isolux::Off), shown(Isolux::Lux));
        let differs = |x: u32, y: u32| plain.get_pixel(x, y) != lined.get_pixel(x, y);
        assert!((0..120).all(|y| differs(49, y) || differs(50, y)), "the line is there, {depth:?}");
        assert!(lined.get_pixel(50, 2).0.iter().all(|byte| *byte > 150), "it is bright");
        assert!((0..120).all(|y| !differs(5, y) && !differs(95, y)), "and nowhere else");
        assert!((0..120).any(|y| differs(38, y)), "its label is wider than the line");
    }
}

#[test]
fn pixels_that_are_no_numbers_and_layers_that_do_not_add_up_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let look = Look::default();
    let mut bad = gradient(1.0);
    bad.pixels[3][1] = f32::NAN;
    let error = Picture { radiance: &bad, layers: &[], irradiance: None, look: &look, units: Units::Photometric }
        .save(&path, &ExportOptions::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("1 pixels"), "{error}");
    for radiance in [gradient(0.5), bad] {
        let layers = [LightLayer { key: "other".into(), radiance }];
        assert!(
            Picture {
                radiance: &gradient(1.0),
                layers: &layers,
                irradiance: None,
                look: &look,
                units: Units::Photometric
            }
            .save(&path, &ExportOptions::default())
            .is_err()
        );
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// A picture with noise and dark parts, told apart into two layers.
fn noisy(width: u32, height: u32) -> (Radiance, [LightLayer; 2]) {
    let value = |i: u32, salt: u32| {
        let bits = (i.wrapping_mul(2_654_435_761) ^ salt).wrapping_mul(2_246_822_519) >> 8;
        let unit = bits as f32 / (1 << 24) as f32;
        if i.is_multiple_of(7) { unit * 1e-3 } else { 1.0 + 300.0 * unit }
    };
    let layer = |salt: u32| {
        let pixels = (0..width * height).map(|i| [value(i, salt), value(i, salt + 1), value(i, salt + 2)]).collect();
        Radiance { width, height, pixels }
    };
    let (a, b) = (layer(1), layer(91));
    let sum = a.pixels.iter().zip(&b.pixels).map(|(a, b)| std::array::from_fn(|c| a[c] + b[c])).collect();
    let layers = [("a", a), ("b", b)].map(|(key, radiance)| LightLayer { key: key.into(), radiance });
    (Radiance { width, height, pixels: sum }, layers)
}

/// All channels of an EXR by their names.
fn channels_of(path: &Path) -> Vec<(String, Vec<f32>, bool)> {
    let image = ::exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image = image.all_attributes().from_file(path).unwrap();
    let channels = image.layer_data.channel_data.list.into_iter();
    let values = |samples: &FlatSamples| samples.values_as_f32().collect();
    channels
        .map(|c| (c.name.to_string(), values(&c.sample_data), matches!(c.sample_data, FlatSamples::F16(_))))
        .collect()
}

#[test]
fn layers_in_halves_add_up_to_the_picture_within_rounding() {
    let folder = tempfile::tempdir().unwrap();
    let (radiance, layers) = noisy(40, 33);
    for compression in [ExrCompression::None, ExrCompression::Zip, ExrCompression::Piz] {
        let path = folder.path().join("a.exr");
        let options = ExportOptions { samples: ExrSamples::Half, compression, ..ExportOptions::default() };
        let look = Look::default();
        Picture { radiance: &radiance, layers: &layers, irradiance: None, look: &look, units: Units::Photometric }
            .save(&path, &options)
            .unwrap();
        let channels = channels_of(&path);
        assert!(channels.len() == 9 && channels.iter().all(|(.., is_half)| *is_half));
        let named = |name: &str| &channels.iter().find(|(n, ..)| n == name).unwrap().1;
        for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
            let (whole, a, b) = (named(name), named(&format!("a.{name}")), named(&format!("b.{name}")));
            for idx in 0..whole.len() {
                // Each of the three numbers is off by half of its last of eleven bits at most.
                let rounding = (whole[idx] + a[idx] + b[idx]) * 2f32.powi(-11) + 2f32.powi(-24);
                assert!((a[idx] + b[idx] - whole[idx]).abs() <= rounding, "{compression:?} {name} {idx}");
                assert!((whole[idx] - radiance.pixels[idx][c]).abs() <= rounding, "{compression:?} {name} {idx}");
            }
        }
    }
}

#[test]
fn every_compression_gives_the_picture_back_lossless_or_nearly() {
    let folder = tempfile::tempdir().unwrap();
    // Odd sizes, several blocks of lines.
    let (radiance, _) = noisy(45, 71);
    let smooth = Radiance {
        pixels: (0..45 * 71).map(|i| [(i % 45) as f32, (i / 45) as f32 * 3.0, 20.0]).collect(),
        ..radiance.clone()
    };
    for (compression, name) in ExrCompression::ALL {
        let path = folder.path().join("a.exr");
        let options = ExportOptions { compression, ..ExportOptions::default() };
        for picture in [&radiance, &smooth] {
            let picture = Picture {
                radiance: picture,
                layers: &[],
                irradiance: None,
                look: &Look::default(),
                units: Units::Photometric,
            };
            picture.save(&path, &options).unwrap();
            let back = read_exr(&path).unwrap();
            if compression != ExrCompression::Dwaa {
                assert_eq!(back, *picture.radiance, "{name}");
            } else if picture.radiance == &smooth {
                let pairs = back.pixels.iter().flatten().zip(smooth.pixels.iter().flatten());
                let worst = pairs.map(|(a, b)| (a - b).abs() / (1.0 + b)).fold(0.0, f32::max);
                assert!(worst > 0.0 && worst < 0.05, "{worst}");
            }
        }
    }
}

#[test]
fn a_region_keeps_its_place_in_the_whole_and_a_width_shrinks_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let (radiance, layers) = noisy(40, 30);
    let region = Some(Region { x: 3, y: 5, width: 12, height: 9 });
    let options = ExportOptions { width_px: Some(20), region, ..ExportOptions::default() };
    let picture = Picture {
        radiance: &radiance,
        layers: &layers,
        irradiance: None,
        look: &Look::default(),
        units: Units::Photometric,
    };
    assert_eq!(picture.save(&path, &options).unwrap().size_px, [12, 9]);
    let header = ::exr::meta::MetaData::read_from_file(&path, true).unwrap().headers.remove(0);
    assert_eq!((header.own_attributes.layer_position, header.layer_size), (Vec2(3, 5), Vec2(12, 9)));
    let display = header.shared_attributes.display_window;
    assert_eq!((display.position, display.size), (Vec2(0, 0), Vec2(20, 15)));
    let mean = |c: usize| [(6, 10), (7, 10), (6, 11), (7, 11)].map(|(x, y)| radiance.pixels[y * 40 + x][c]);
    let first = read_exr(&path).unwrap().pixels[0];
    for (c, is) in first.into_iter().enumerate() {
        let expected = mean(c).iter().sum::<f32>() / 4.0;
        assert!((is - expected).abs() < 1e-4 * expected, "{is} {expected}");
    }

    let png = folder.path().join("a.png");
    let shown = picture.save(&png, &options).unwrap();
    assert_eq!(image::image_dimensions(&png).unwrap(), (12, 9));
    let whole = picture.save(&png, &ExportOptions::default()).unwrap();
    assert_eq!((shown.size_px, whole.size_px), ([12, 9], [40, 30]));
    assert_eq!((shown.exposure_ev, shown.legend), (whole.exposure_ev, whole.legend), "a part is shown as the whole is");
}

#[test]
fn what_halves_cannot_tell_is_refused_and_floats_hold_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let sun = gradient(1e5);
    let picture =
        Picture { radiance: &sun, layers: &[], irradiance: None, look: &Look::default(), units: Units::Photometric };
    for options in [
        ExportOptions { samples: ExrSamples::Half, ..ExportOptions::default() },
        ExportOptions { compression: ExrCompression::Dwaa, ..ExportOptions::default() },
    ] {
        let error = format!("{:#}", picture.save(&path, &options).unwrap_err());
        assert!(error.contains("12 pixels are brighter") && !path.exists(), "{error}");
    }
    picture.save(&path, &ExportOptions::default()).unwrap();
    assert_eq!(read_exr(&path).unwrap(), sun);
}

#[test]
fn a_png_of_sixteen_bits_holds_what_is_shown_and_its_legend() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let radiance = gradient(1.0);
    let options = ExportOptions { depth: PngDepth::Sixteen, ..ExportOptions::default() };
    let mut look = Look::default();
    for false_color in [None, Some(FalseColor::default())] {
        look.display.false_color = false_color;
        let picture =
            Picture { radiance: &radiance, layers: &[], irradiance: None, look: &look, units: Units::Photometric };
        let shown = picture.save(&path, &options).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(&bytes[37..41], b"sRGB");
        let image::DynamicImage::ImageRgb16(decoded) = image::load_from_memory(&bytes).unwrap() else {
            panic!("sixteen bits were asked for")
        };
        let params = look.display.metered(&radiance);
        let cut = image::imageops::crop_imm(&decoded, 0, 0, 4, 3).to_image();
        assert_eq!(cut.into_raw(), encode16(&radiance, &params));
        assert_eq!(decoded.width() > 4, shown.legend.is_some());
        assert_eq!(shown.size_px, [decoded.width(), decoded.height()]);
    }
}

//! What can be typed about a picture file: depth, packing, size and part.

use anyhow::{Result, bail};
use clap::Args;

use super::args::Layers;
use crate::export::ImageFormat;
use crate::export::layers::LayerSet;
use crate::export::options::{ExportOptions, ExrCompression, ExrSamples, PngDepth, Region};

/// Numbers of a picture file.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct DepthArgs {
    /// Bits per channel: 8 (default) or 16 of a .png, 16 (halves) or 32 (floats, default) of an .exr.
    #[arg(long, value_name = "8|16|32", value_parser = parse_bits, allow_negative_numbers = true)]
    pub bits: Option<u32>,
    /// How an .exr is packed [default: zip]; `dwaa` is lossy and keeps halves.
    #[arg(long, value_enum)]
    pub compression: Option<ExrCompression>,
}

/// How much of a picture is written.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct CutArgs {
    /// Pixels across, at most as many as were baked: averaged in linear light; the height follows.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), allow_negative_numbers = true)]
    pub width: Option<u32>,
    /// Write this part alone, in pixels of the picture from its top left corner; an .exr remembers where it lies.
    #[arg(long, value_name = "X,Y,W,H", value_parser = parse_region)]
    pub region: Option<Region>,
}

/// The file that was asked for.
///
/// # Errors
/// If the format does not have what was asked of it.
pub(super) fn options(format: ImageFormat, depth: DepthArgs, cut: CutArgs, layers: &[Layers]) -> Result<ExportOptions> {
    let sets = layers.iter().filter_map(|layer| match layer {
        Layers::Lights => Some(LayerSet::Lights),
        Layers::Groups => Some(LayerSet::Groups),
        Layers::None | Layers::Irradiance => None,
    });
    let sets: Vec<LayerSet> = sets.collect();
    if layers.contains(&Layers::None) && layers.len() > 1 {
        bail!("--layers takes `none` or others, not both");
    }
    if sets.len() > 1 {
        bail!("--layers takes `lights` or `groups`, not both: together they would be twice the picture");
    }
    let mut options = ExportOptions {
        layers: sets.first().copied().unwrap_or_default(),
        irradiance: layers.contains(&Layers::Irradiance),
        compression: depth.compression.unwrap_or_default(),
        width_px: cut.width,
        region: cut.region,
        ..ExportOptions::default()
    };
    match (format, depth.bits) {
        (ImageFormat::Png, _) if depth.compression.is_some() => {
            bail!("--compression is for .exr; leave it out for a .png")
        }
        (ImageFormat::Png, None | Some(8)) => options.depth = PngDepth::Eight,
        (ImageFormat::Png, Some(16)) => options.depth = PngDepth::Sixteen,
        (ImageFormat::Png, Some(_)) => bail!("a .png has 8 or 16 bits per channel; write an .exr for 32"),
        (ImageFormat::Exr, Some(32)) if options.compression == ExrCompression::Dwaa => {
            bail!("--compression dwaa keeps halves; leave out --bits 32, or take zip or piz")
        }
        (ImageFormat::Exr, None | Some(32)) => options.samples = ExrSamples::Float,
        (ImageFormat::Exr, Some(16)) => options.samples = ExrSamples::Half,
        (ImageFormat::Exr, Some(_)) => bail!("an .exr has 16 or 32 bits per channel; write a .png for 8"),
    }
    Ok(options)
}

fn parse_bits(text: &str) -> Result<u32, String> {
    text.parse().ok().filter(|bits| [8, 16, 32].contains(bits)).ok_or_else(|| "write 8, 16 or 32".into())
}

fn parse_region(text: &str) -> Result<Region, String> {
    let numbers: Vec<u32> = text.split(',').map_while(|number| number.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, width, height] if width > 0 && height > 0 && text.split(',').count() == 4 => {
            Ok(Region { x, y, width, height })
        }
        _ => Err("write X,Y,WIDTH,HEIGHT in pixels, such as 100,50,320,240".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(format: ImageFormat, bits: Option<u32>, compression: Option<ExrCompression>) -> Result<ExportOptions> {
        options(format, DepthArgs { bits, compression }, CutArgs::default(), &[])
    }

    #[test]
    fn bits_and_packing_go_with_their_format() {
        assert_eq!(of(ImageFormat::Png, None, None).unwrap(), ExportOptions::default());
        assert_eq!(of(ImageFormat::Png, Some(16), None).unwrap().depth, PngDepth::Sixteen);
        assert_eq!(of(ImageFormat::Exr, Some(16), None).unwrap().samples, ExrSamples::Half);
        for (format, bits, compression, words) in [
            (ImageFormat::Png, Some(32), None, "8 or 16"),
            (ImageFormat::Exr, Some(8), None, "16 or 32"),
            (ImageFormat::Png, None, Some(ExrCompression::Piz), "leave it out"),
            (ImageFormat::Exr, Some(32), Some(ExrCompression::Dwaa), "halves"),
        ] {
            let said = of(format, bits, compression).unwrap_err().to_string();
            assert!(said.contains(words), "{said}");
        }
    }

    #[test]
    fn lights_and_groups_exclude_each_other_and_irradiance_goes_with_both() {
        let of = |layers: &[Layers]| options(ImageFormat::Exr, DepthArgs::default(), CutArgs::default(), layers);
        let both = of(&[Layers::Groups, Layers::Irradiance]).unwrap();
        assert_eq!((both.layers, both.irradiance), (LayerSet::Groups, true));
        assert!(of(&[Layers::Groups, Layers::Lights]).is_err());
        assert!(of(&[Layers::None]).is_ok() && of(&[Layers::None, Layers::Lights]).is_err());
    }

    #[test]
    fn regions_are_four_numbers() {
        assert_eq!(parse_region("1, 2,3,4").unwrap(), Region { x: 1, y: 2, width: 3, height: 4 });
        for bad in ["", "1,2,3", "1,2,3,4,5", "1,2,0,4", "-1,2,3,4", "a,2,3,4"] {
            assert!(parse_region(bad).is_err(), "{bad}");
        }
    }
}

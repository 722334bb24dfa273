//! What each light brings to some pixels of the picture: rows of the matrix times the coefficients of its columns.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use clerestory_nystrom::BlockLowRank;
use clerestory_relight::mean_row;
use clerestory_transport::light::{LightRig, luminance};
use clerestory_transport::sky::Backdrop;
use glam::Vec3;

use super::Shown;
use super::lamps::{LampLight, LampPart};

/// What a light brings to some pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Share {
    /// Key of the light.
    pub key: String,
    /// Its part of the mean radiance, nit per channel.
    pub radiance: Vec3,
    /// Its part of the mean irradiance, lux; where that was asked for and is known.
    pub lux: Option<f32>,
    /// Whether it is a light of the scene, and no lamp that was added.
    pub is_of_scene: bool,
}

impl Share {
    /// Luminance in cd/m².
    pub fn luminance(&self) -> f32 {
        luminance(self.radiance)
    }
}

/// The mean radiance that some shares make together, nit per channel.
pub fn sum(shares: &[Share]) -> Vec3 {
    shares.iter().map(|share| share.radiance).sum()
}

impl Shown {
    /// What each light brings to the mean over some pixels under a rig and the light of its free lamps, the brightest first;
    /// `None` where these pixels are not baked yet. Together they are the picture, unlit surfaces included.
    pub fn shares(&self, rig: &LightRig, light: Option<&LampLight>, pixels: &[u32]) -> Option<Vec<Share>> {
        let basis = &self.header.basis;
        let terms = |rig: &LightRig| -> Option<[Vec<[f32; 3]>; 2]> {
            let row = mean_row(&self.lit_groups(rig, pixels), pixels)?.into_iter().flatten().collect();
            Some([row, self.header.coefficients(rig).into_iter().flatten().collect()])
        };
        // Without a sun that shines from columns of the sky each of them is of one light.
        let sun = basis.sun_apart(rig);
        let [row, coefficients] = terms(sun.as_ref().map_or(rig, |sun| &sun.without))?;
        let brought = |column: usize, x: Vec3| Vec3::from(row[column]) * x;
        let mut shares: Vec<Share> = basis
            .sources
            .iter()
            .map(|source| {
                let columns = source.columns.clone().map(|column| column as usize);
                let radiance = columns.map(|column| brought(column, Vec3::from(coefficients[column]))).sum();
                Share { key: source.key.clone(), radiance, lux: None, is_of_scene: true }
            })
            .collect();
        if let Some(sun) = &sun {
            let [row, coefficients] = terms(&sun.alone)?;
            let brought: Vec3 = row.iter().zip(&coefficients).map(|(row, x)| Vec3::from(*row) * Vec3::from(*x)).sum();
            let own = shares.iter_mut().find(|share| share.key == sun.source.key);
            own.into_iter().for_each(|share| share.radiance += brought);
        }
        let first_patch = basis.patch_columns().map_or(row.len(), |columns| columns.start as usize);
        shares.extend(light.into_iter().flat_map(|light| &light.parts).map(|part| {
            let direct: Vec3 = pixels.iter().map(|pixel| part.direct(*pixel)).sum::<Vec3>() / pixels.len() as f32;
            let columns = first_patch..row.len();
            let indirect: Vec3 = columns.zip(LampPart::of_patches(part)).map(|(column, x)| brought(column, x)).sum();
            Share { key: part.key.clone(), radiance: direct + indirect, lux: None, is_of_scene: false }
        }));
        shares.sort_by(|a, b| b.luminance().total_cmp(&a.luminance()));
        Some(shares)
    }

    /// Tells of each share what arrives of its light at the same pixels, where that is baked, and measured of a free lamp. Together
    /// they are the irradiance there.
    pub fn add_lux(&self, shares: &mut [Share], rig: &LightRig, light: Option<&LampLight>, pixels: &[u32]) {
        let Some(set) = self.pixel_irradiance() else { return };
        let Some(row) = mean_row(&self.irradiance[set], pixels) else { return };
        let row: Vec<Vec3> = row.into_iter().flatten().map(Vec3::from).collect();
        let under = |rig: &LightRig| -> Vec<Vec3> {
            let coefficients = self.header.irradiance_coefficients(set, rig).into_iter().flatten().map(Vec3::from);
            row.iter().zip(coefficients).map(|(row, x)| *row * x).collect()
        };
        let basis = &self.header.basis;
        let sun = basis.sun_apart(rig);
        let baked = under(sun.as_ref().map_or(rig, |sun| &sun.without));
        let of_sun = sun.map(|sun| (sun.source.key.as_str(), under(&sun.alone).into_iter().sum::<Vec3>()));
        let of_columns = |columns: &Range<u32>| -> Vec3 { columns.clone().map(|column| baked[column as usize]).sum() };
        let first_patch = basis.patch_columns().map_or(row.len(), |columns| columns.start as usize);
        let of_lamp = |part: &LampPart| {
            let straight: Vec3 = pixels.iter().map(|pixel| part.arriving(*pixel)).sum::<Vec3>() / pixels.len() as f32;
            straight + row[first_patch..].iter().zip(part.of_patches()).map(|(row, x)| *row * x).sum::<Vec3>()
        };
        let of_scene = basis.sources.iter().map(|source| {
            let moved = of_sun.filter(|(key, _)| *key == source.key).map_or(Vec3::ZERO, |(_, lux)| lux);
            ((source.key.as_str(), true), of_columns(&source.columns) + moved)
        });
        let parts = light.into_iter().flat_map(|light| &light.parts).filter(|part| part.is_measured());
        let lamps = parts.map(|part| ((part.key.as_str(), false), of_lamp(part)));
        let brought: BTreeMap<(&str, bool), f32> =
            of_scene.chain(lamps).map(|(of, lux)| (of, luminance(lux))).collect();
        for share in shares {
            share.lux = brought.get(&(share.key.as_str(), share.is_of_scene)).copied();
        }
    }

    /// Mean irradiance over some pixels under a rig and the light of its free lamps, lux per channel; `None` where it is not
    /// baked, or that of the lamps not there yet.
    pub fn irradiance_at(&self, rig: &LightRig, light: Option<&LampLight>, pixels: &[u32]) -> Option<Vec3> {
        let set = self.pixel_irradiance()?;
        let row = mean_row(&self.irradiance[set], pixels)?;
        let coefficients = self.irradiance_coefficients(set, rig, light);
        let terms = row.iter().flatten().zip(coefficients.iter().flatten());
        let baked: Vec3 = terms.map(|(row, x)| Vec3::from(*row) * Vec3::from(*x)).sum();
        let Some(light) = light else { return Some(baked) };
        let straight = light.arriving.as_ref().filter(|_| light.left_out.is_empty())?;
        let lux = pixels.iter().filter_map(|pixel| straight.pixels.get(*pixel as usize)).map(|lux| Vec3::from(*lux));
        Some(baked + lux.sum::<Vec3>() / pixels.len() as f32)
    }

    /// The matrices of the picture as they are lit: where some pixels see the sky, its map stands in their blocks.
    fn lit_groups(&self, rig: &LightRig, pixels: &[u32]) -> Vec<Cow<'_, BlockLowRank>> {
        let mut groups: Vec<Cow<BlockLowRank>> = self.frame.groups.iter().map(Cow::Borrowed).collect();
        if let Some(backdrop) = Backdrop::new(&self.header, rig) {
            let group = groups[backdrop.group].to_mut();
            let mut blocks: Vec<usize> =
                pixels.iter().filter_map(|pixel| Some(group.partition.place(*pixel)?.0)).collect();
            blocks.sort_unstable();
            blocks.dedup();
            let mut bundles = Vec::new();
            for block_idx in blocks {
                group.partition.bundles(block_idx, &mut bundles);
                if let Some(block) = &mut group.blocks[block_idx] {
                    *block = Arc::new(backdrop.lit(block, &bundles));
                }
            }
        }
        groups
    }
}

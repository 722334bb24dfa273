//! Patches as bytes behind the header of a file: the number of samples of each patch (u8), position, normal and radius of
//! each sample and how it takes grazing light (f32), middle, normal and area of each patch (f32), what each patch brings to
//! each coefficient (a scale f32 per column, then f16), FNV-1a u64.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

use std::sync::Arc;

use clerestory_nystrom::codec::checksum;
use glam::Vec3;
use half::f16;

use super::layout::Layout;
use super::nearest::{Center, Nearest};
use super::{Body, MOST_PATCHES, PatchSample, Patches};

const CHECKSUM_LEN: usize = 8;
const SAMPLE_LEN: usize = 32;
/// The same in files from before samples knew of grazing light.
const EARLIER_SAMPLE_LEN: usize = 28;
/// Middle, normal and area of a patch; none in files from before patches knew their areas.
const EXTENT_LEN: usize = 28;
/// Columns that are believed of a file.
const MOST_COLUMNS: u32 = 4096;
/// Samples of a patch that are believed of a file.
const MOST_SAMPLES: u32 = 255;

/// What a file keeps of patches.
#[expect(clippy::cast_possible_truncation, reason = "at most `MOST_SAMPLES` of a patch, of at most `MOST_COLUMNS`")]
pub(crate) fn encode(patches: &Patches) -> Vec<u8> {
    let body = &patches.body;
    #[expect(clippy::arithmetic_side_effects, reason = "patches begin one after the other")]
    let mut bytes: Vec<u8> = body.first.windows(2).map(|w| (w[1] - w[0]) as u8).collect();
    for sample in &body.samples {
        let grazing = patches.knows_grazing.then_some(sample.grazing);
        let place = sample.position.to_array().into_iter().chain(sample.normal.to_array());
        place.chain([sample.radius_m]).chain(grazing).for_each(|x| bytes.extend(x.to_le_bytes()));
    }
    for (center, area_m2) in
        body.layout.iter().flat_map(|layout| layout.nearest.centers().iter().zip(layout.areas_m2()))
    {
        let place = center.position.to_array().into_iter().chain(center.normal.to_array());
        place.chain([area_m2]).for_each(|x| bytes.extend(x.to_le_bytes()));
    }
    let scales = scales(&body.shares, patches.n_columns());
    scales.iter().for_each(|scale| bytes.extend(scale.to_le_bytes()));
    for (share, scale) in body.shares.iter().zip(scales.iter().cycle()) {
        bytes.extend(f16::from_f32(share / scale).to_le_bytes());
    }
    let sum = checksum(&bytes);
    bytes.extend(sum.to_le_bytes());
    bytes
}

/// A power of two for each column that brings its largest share to 1 or a little more.
fn scales(shares: &[f32], n_columns: usize) -> Vec<f32> {
    let mut largest = vec![0.0f32; n_columns];
    for row in shares.chunks_exact(n_columns.max(1)) {
        largest.iter_mut().zip(row).for_each(|(largest, share)| *largest = largest.max(share.abs()));
    }
    let scale = |x: f32| if x > 0.0 { x.log2().floor().clamp(-100.0, 100.0).exp2() } else { 1.0 };
    largest.into_iter().map(scale).collect()
}

/// Shares as a file gives them back.
pub(super) fn rounded(shares: &mut [f32], n_columns: usize) {
    let scales = scales(shares, n_columns);
    for (share, scale) in shares.iter_mut().zip(scales.iter().cycle()) {
        *share = f16::from_f32(*share / scale).to_f32() * scale;
    }
}

/// Reads patches whose numbers are known from the header, and says how many bytes they took; `None` where these do not fit.
#[expect(clippy::cast_possible_truncation, reason = "at most `MOST_SAMPLES` of a patch, of at most `MOST_COLUMNS`")]
pub(crate) fn decode(header: &Patches, bytes: &[u8]) -> Option<(Patches, usize)> {
    let (n_patches, n_samples, n_columns) = (header.n_patches, header.n_samples, header.n_columns);
    #[expect(clippy::arithmetic_side_effects, reason = "at most `MOST_PATCHES`, of `MOST_SAMPLES` each")]
    let plausible = (1..=MOST_PATCHES).contains(&n_patches)
        && (1..=MOST_COLUMNS).contains(&n_columns)
        && (n_patches..=n_patches * MOST_SAMPLES).contains(&n_samples);
    if !plausible {
        return None;
    }
    let sample_len = if header.knows_grazing { SAMPLE_LEN } else { EARLIER_SAMPLE_LEN };
    let extent_len = if header.knows_areas() { EXTENT_LEN } else { 0 };
    let [n_patches, n_samples, n_columns] = [n_patches, n_samples, n_columns].map(|n| n as usize);
    #[expect(clippy::arithmetic_side_effects, reason = "plausible counts: less than 2^40 bytes")]
    let [places_len, extents_len, scales_len] = [n_samples * sample_len, n_patches * extent_len, n_columns * 4];
    #[expect(clippy::arithmetic_side_effects, reason = "plausible counts: less than 2^40 bytes")]
    let len = n_patches + places_len + extents_len + scales_len + n_patches * n_columns * 2;
    let end = len.checked_add(CHECKSUM_LEN)?;
    let (content, stored) = (bytes.get(..len)?, bytes.get(len..end)?);
    if *stored != checksum(content).to_le_bytes() {
        return None;
    }
    let (counts, rest) = content.split_at(n_patches);
    let (places, rest) = rest.split_at(places_len);
    let (extents, rest) = rest.split_at(extents_len);
    let (scales, shares) = rest.split_at(scales_len);
    let number = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let mut first = vec![0u32];
    let mut weights = Vec::with_capacity(n_samples);
    for &count in counts {
        weights.extend(std::iter::repeat_n(1.0 / f32::from(count), count.into()));
        first.push(weights.len() as u32);
    }
    let place = |(bytes, weight): (&[u8], f32)| {
        #[expect(clippy::arithmetic_side_effects, reason = "24 of the bytes of a sample")]
        let [position, normal] = [0, 12].map(|at| Vec3::from_array([0, 4, 8].map(|axis| number(&bytes[at + axis..]))));
        let grazing = bytes.get(28..32).map_or(0.0, number);
        PatchSample { position, normal, weight, radius_m: number(&bytes[24..]), grazing }
    };
    let samples: Vec<PatchSample> = places.chunks_exact(sample_len).zip(weights.iter().copied()).map(place).collect();
    let scales: Vec<f32> = scales.chunks_exact(4).map(number).collect();
    let share = |(bytes, scale): (&[u8], &f32)| f16::from_le_bytes([bytes[0], bytes[1]]).to_f32() * scale;
    let shares: Vec<f32> = shares.chunks_exact(2).zip(scales.iter().cycle()).map(share).collect();
    let finite = samples
        .iter()
        .all(|s| s.position.is_finite() && s.normal.is_finite() && s.radius_m.is_finite() && s.grazing.is_finite())
        && shares.iter().all(|s| s.is_finite());
    if weights.len() != n_samples || counts.contains(&0) || !finite {
        return None;
    }
    let layout = if header.knows_areas() { Some(layout(header, extents, (&samples, &first))?) } else { None };
    let body = Arc::new(Body { samples, first, shares, layout, table: None });
    Some((Patches { body, ..header.clone() }, end))
}

/// Where patches lie, from the bytes of all of them; `None` where a number is none.
fn layout(header: &Patches, bytes: &[u8], samples: (&[PatchSample], &[u32])) -> Option<Layout> {
    let numbers = |bytes: &[u8]| -> [f32; 7] {
        let (words, _) = bytes.as_chunks();
        std::array::from_fn(|nth| f32::from_le_bytes(words[nth]))
    };
    let extents: Vec<[f32; 7]> = bytes.chunks_exact(EXTENT_LEN).map(numbers).collect();
    let sensible = |numbers: &[f32; 7]| numbers.iter().all(|x| x.is_finite()) && numbers[6] >= 0.0;
    if !header.reach_m.is_finite() || !extents.iter().all(sensible) {
        return None;
    }
    let center = |x: &[f32; 7]| Center { position: Vec3::new(x[0], x[1], x[2]), normal: Vec3::new(x[3], x[4], x[5]) };
    let nearest = Nearest::new(extents.iter().map(center).collect(), header.reach_m);
    let areas_m2: Vec<f32> = extents.iter().map(|x| x[6]).collect();
    Some(Layout::new(Arc::new(nearest), samples, &areas_m2))
}

//! Typed reads of accessors with every bound checked; the reason for a refusal is in words.

use super::container::Buffers;
use super::document::{Accessor, Document, Sparse};

/// Most elements of an accessor without bytes behind it (all zeros), so that a few characters cannot ask for a terabyte.
const MAX_ELEMENTS_WITHOUT_BYTES: usize = 1 << 24;

/// How integers become floats.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Integers {
    /// As the accessor's `normalized` says.
    AsDeclared,
    /// To 0…1 or −1…1 whatever the accessor says.
    Normalized,
}

/// Reads accessors of one file.
pub(super) struct Reader<'a> {
    pub document: &'a Document,
    pub buffers: &'a Buffers<'a>,
}

impl Reader<'_> {
    /// Elements with exactly `N` floats, from any component type.
    pub fn floats<const N: usize>(&self, index: usize, integers: Integers) -> Result<Vec<[f32; N]>, String> {
        let accessor = self.accessor(index)?;
        let n = n_components(&accessor.shape)?;
        if n != N {
            return Err(format!("accessor {index} holds {} where {N} numbers are needed", accessor.shape));
        }
        let component = Component::of(accessor.component_type)?;
        let normalized = accessor.normalized || integers == Integers::Normalized;
        let decode =
            |bytes: &[u8]| std::array::from_fn(|c| component.float(&bytes[c * component.size()..], normalized));
        self.elements(index, accessor, [0.0; N], component.size() * N, decode)
    }

    /// Linear RGBA; alpha is 1 where the file gives RGB.
    pub fn colors(&self, index: usize) -> Result<Vec<[f32; 4]>, String> {
        if self.accessor(index)?.shape == "VEC3" {
            let rgb = self.floats::<3>(index, Integers::Normalized)?;
            return Ok(rgb.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect());
        }
        self.floats::<4>(index, Integers::Normalized)
    }

    /// Vertex indices from u8, u16 or u32.
    pub fn indices(&self, index: usize) -> Result<Vec<u32>, String> {
        let accessor = self.accessor(index)?;
        let component = Component::of(accessor.component_type)?;
        if accessor.shape != "SCALAR" || !component.is_index() {
            return Err(format!("accessor {index} does not hold indices"));
        }
        self.elements(index, accessor, 0, component.size(), |bytes| component.index(bytes))
    }

    /// Whether an accessor is more than zeros.
    pub fn has_bytes(&self, index: usize) -> bool {
        self.accessor(index).is_ok_and(|accessor| accessor.buffer_view.is_some() || accessor.sparse.is_some())
    }

    fn accessor(&self, index: usize) -> Result<&Accessor, String> {
        self.document.accessors.get(index).ok_or_else(|| format!("accessor {index} does not exist"))
    }

    /// Dense elements, with sparse ones put over them.
    fn elements<T: Clone>(
        &self,
        index: usize,
        accessor: &Accessor,
        zero: T,
        size: usize,
        decode: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>, String> {
        let mut elements = match accessor.buffer_view {
            Some(view) => {
                let (bytes, stride) = self.buffers.view(view)?;
                let bytes = strided(bytes, accessor.byte_offset, stride, size, accessor.count)
                    .ok_or_else(|| format!("accessor {index} reaches beyond the end of its buffer view"))?;
                bytes.map(&decode).collect()
            }
            None if accessor.count > MAX_ELEMENTS_WITHOUT_BYTES => {
                return Err(format!("accessor {index} asks for {} elements without giving them", accessor.count));
            }
            None => vec![zero; accessor.count],
        };
        if let Some(sparse) = &accessor.sparse {
            self.overlay(index, sparse, &mut elements, size, decode)?;
        }
        Ok(elements)
    }

    fn overlay<T>(
        &self,
        index: usize,
        sparse: &Sparse,
        elements: &mut [T],
        size: usize,
        decode: impl Fn(&[u8]) -> T,
    ) -> Result<(), String> {
        let beyond = || format!("the sparse part of accessor {index} reaches beyond the end of its data");
        let component = Component::of(sparse.indices.component_type)?;
        if !component.is_index() {
            return Err(format!("the sparse part of accessor {index} does not hold indices"));
        }
        let (bytes, _) = self.buffers.view(sparse.indices.buffer_view)?;
        let places = strided(bytes, sparse.indices.byte_offset, None, component.size(), sparse.count);
        let (bytes, _) = self.buffers.view(sparse.values.buffer_view)?;
        let values = strided(bytes, sparse.values.byte_offset, None, size, sparse.count);
        for (place, value) in places.ok_or_else(beyond)?.zip(values.ok_or_else(beyond)?) {
            let place = component.index(place) as usize;
            *elements.get_mut(place).ok_or_else(beyond)? = decode(value);
        }
        Ok(())
    }
}

/// `count` elements of `size` bytes, `None` when they do not all fit.
fn strided(
    bytes: &[u8],
    offset: usize,
    stride: Option<usize>,
    size: usize,
    count: usize,
) -> Option<impl Iterator<Item = &[u8]>> {
    let stride = stride.filter(|&stride| stride > 0).unwrap_or(size);
    if count > 0 {
        let last = (count - 1).checked_mul(stride)?.checked_add(offset)?;
        bytes.get(last..last.checked_add(size)?)?;
    }
    Some((0..count).map(move |i| &bytes[offset + i * stride..][..size]))
}

fn n_components(shape: &str) -> Result<usize, String> {
    match shape {
        "SCALAR" => Ok(1),
        "VEC2" => Ok(2),
        "VEC3" => Ok(3),
        "VEC4" => Ok(4),
        _ => Err(format!("vertex data of type {shape:?} is not known")),
    }
}

/// Component types of glTF.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(code: u32) -> Result<Component, String> {
        Ok(match code {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            5126 => Component::F32,
            _ => return Err(format!("component type {code} is not known")),
        })
    }

    fn size(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }

    fn is_index(self) -> bool {
        matches!(self, Component::U8 | Component::U16 | Component::U32)
    }

    fn index(self, bytes: &[u8]) -> u32 {
        match self {
            Component::U8 => u32::from(bytes[0]),
            Component::U16 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            _ => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        }
    }

    /// Normalization as glTF 2.0 §3.6.2.2 has it: `max(c / 127, −1)` for signed bytes.
    fn float(self, bytes: &[u8], normalized: bool) -> f32 {
        let (value, scale) = match self {
            Component::F32 => return f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            Component::I8 => (f32::from(bytes[0] as i8), 127.0),
            Component::U8 => (f32::from(bytes[0]), 255.0),
            Component::I16 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
            Component::U16 => (f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
            Component::U32 => (u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as f32, u32::MAX as f32),
        };
        if normalized { (value / scale).max(-1.0) } else { value }
    }
}

//! Typed reads of accessors with every bound checked; the reason for a refusal is in words.

use gltf::json::Root;
use gltf::json::accessor::sparse::Sparse;
use gltf::json::accessor::{Accessor, ComponentType, GenericComponentType, IndexComponentType, Type};
use gltf::json::validation::Checked;

use super::container::Buffers;
use super::document::size;
use crate::stop::Stop;

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
    pub document: &'a Root,
    pub buffers: &'a Buffers<'a>,
    /// Whether the file is still wanted.
    pub stop: &'a Stop,
    /// The elements that are read, in order, each once; all of them where there is none.
    pub picked: Option<&'a [u32]>,
}

impl Reader<'_> {
    /// Elements with exactly `N` floats, from any component type; 16 are a matrix, column by column.
    #[expect(clippy::arithmetic_side_effects, reason = "at most sixteen numbers of four bytes")]
    pub fn floats<const N: usize>(&self, index: usize, integers: Integers) -> Result<Vec<[f32; N]>, String> {
        let accessor = self.accessor(index)?;
        let fits = match accessor.type_ {
            Checked::Valid(shape @ (Type::Scalar | Type::Vec2 | Type::Vec3 | Type::Vec4 | Type::Mat4)) => {
                shape.multiplicity() == N
            }
            _ => false,
        };
        if !fits {
            return Err(format!("accessor {index} does not hold elements of {N} numbers, which are needed"));
        }
        let component = component_of(index, accessor)?;
        let normalized = accessor.normalized || integers == Integers::Normalized;
        let decode =
            |bytes: &[u8]| std::array::from_fn(|c| float_from(component, &bytes[c * component.size()..], normalized));
        self.elements(index, accessor, [0.0; N], component.size() * N, decode)
    }

    /// Linear RGBA; alpha is 1 where the file gives RGB.
    pub fn colors(&self, index: usize) -> Result<Vec<[f32; 4]>, String> {
        if matches!(self.accessor(index)?.type_, Checked::Valid(Type::Vec3)) {
            let rgb = self.floats::<3>(index, Integers::Normalized)?;
            return Ok(rgb.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect());
        }
        self.floats::<4>(index, Integers::Normalized)
    }

    /// Vertex indices from u8, u16 or u32.
    pub fn indices(&self, index: usize) -> Result<Vec<u32>, String> {
        let accessor = self.accessor(index)?;
        let component = component_of(index, accessor)?;
        if !matches!(accessor.type_, Checked::Valid(Type::Scalar)) || !is_index(component) {
            return Err(format!("accessor {index} does not hold indices"));
        }
        self.elements(index, accessor, 0, component.size(), |bytes| index_from(component, bytes))
    }

    /// How many elements an accessor may give, without a look at them: never more than it has bytes.
    pub fn n_elements(&self, index: usize) -> u64 {
        let Ok(accessor) = self.accessor(index) else { return 0 };
        let count = size(accessor.count);
        let most = match accessor.buffer_view {
            Some(view) => self.buffers.view(view.value()).map_or(0, |(bytes, _)| bytes.len()),
            None => MAX_ELEMENTS_WITHOUT_BYTES,
        };
        count.min(most) as u64
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
        n_bytes: usize,
        decode: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>, String> {
        self.stop.check().map_err(|stopped| stopped.to_string())?;
        let count = size(accessor.count);
        if self.picked.and_then(<[u32]>::last).is_some_and(|&last| last as usize >= count) {
            return Err(format!("accessor {index} has {count} elements, too few for its vertices"));
        }
        let mut elements = match accessor.buffer_view.map(|view| view.value()) {
            Some(view) => {
                let (bytes, stride) = self.buffers.view(view)?;
                let element = strided(bytes, accessor.byte_offset.map_or(0, size), stride, n_bytes, count)
                    .ok_or_else(|| format!("accessor {index} reaches beyond the end of its buffer view"))?;
                match self.picked {
                    Some(picked) => picked.iter().map(|&place| decode(element(place as usize))).collect(),
                    None => (0..count).map(|place| decode(element(place))).collect(),
                }
            }
            None if count > MAX_ELEMENTS_WITHOUT_BYTES => {
                return Err(format!("accessor {index} asks for {} elements without giving them", count));
            }
            None => vec![zero; self.picked.map_or(count, <[u32]>::len)],
        };
        if let Some(sparse) = &accessor.sparse {
            self.overlay((index, count), sparse, &mut elements, n_bytes, decode)?;
        }
        Ok(elements)
    }

    fn overlay<T>(
        &self,
        (index, n_elements): (usize, usize),
        sparse: &Sparse,
        elements: &mut [T],
        n_bytes: usize,
        decode: impl Fn(&[u8]) -> T,
    ) -> Result<(), String> {
        let beyond = || format!("the sparse part of accessor {index} reaches beyond the end of its data");
        let Checked::Valid(IndexComponentType(component)) = sparse.indices.component_type else {
            return Err(format!("the sparse part of accessor {index} does not hold indices"));
        };
        let count = size(sparse.count);
        let (bytes, _) = self.buffers.view(sparse.indices.buffer_view.value())?;
        let places = strided(bytes, size(sparse.indices.byte_offset), None, component.size(), count);
        let (bytes, _) = self.buffers.view(sparse.values.buffer_view.value())?;
        let values = strided(bytes, size(sparse.values.byte_offset), None, n_bytes, count);
        let (place, value) = (places.ok_or_else(beyond)?, values.ok_or_else(beyond)?);
        for nth in 0..count {
            let place = index_from(component, place(nth));
            if place as usize >= n_elements {
                return Err(beyond());
            }
            let at = self.picked.map_or(Some(place as usize), |picked| picked.binary_search(&place).ok());
            if let Some(element) = at.and_then(|at| elements.get_mut(at)) {
                *element = decode(value(nth));
            }
        }
        Ok(())
    }
}

/// Where `count` elements of `size` bytes are, by their places; `None` when they do not all fit.
fn strided<'b>(
    bytes: &'b [u8],
    offset: usize,
    stride: Option<usize>,
    size: usize,
    count: usize,
) -> Option<impl Fn(usize) -> &'b [u8]> {
    let stride = stride.filter(|&stride| stride > 0).unwrap_or(size);
    if let Some(n_before) = count.checked_sub(1) {
        let last = n_before.checked_mul(stride)?.checked_add(offset)?;
        bytes.get(last..last.checked_add(size)?)?;
    }
    #[expect(clippy::arithmetic_side_effects, reason = "the end of the last element is within the bytes")]
    let element = move |place: usize| &bytes[offset + place * stride..][..size];
    Some(element)
}

/// The component type of an accessor, which may be one that glTF does not have.
fn component_of(index: usize, accessor: &Accessor) -> Result<ComponentType, String> {
    match accessor.component_type {
        Checked::Valid(GenericComponentType(component)) => Ok(component),
        Checked::Invalid => Err(format!("accessor {index} has an unknown component type")),
    }
}

fn is_index(component: ComponentType) -> bool {
    matches!(component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32)
}

fn index_from(component: ComponentType, bytes: &[u8]) -> u32 {
    match component {
        ComponentType::U8 => u32::from(bytes[0]),
        ComponentType::U16 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        _ => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    }
}

/// Normalization as glTF 2.0 §3.6.2.2 has it: `max(c / 127, −1)` for signed bytes.
fn float_from(component: ComponentType, bytes: &[u8], normalized: bool) -> f32 {
    let (value, scale) = match component {
        ComponentType::F32 => return f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        ComponentType::I8 => (f32::from(bytes[0] as i8), 127.0),
        ComponentType::U8 => (f32::from(bytes[0]), 255.0),
        ComponentType::I16 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
        ComponentType::U16 => (f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
        ComponentType::U32 => (u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as f32, u32::MAX as f32),
    };
    if normalized { (value / scale).max(-1.0) } else { value }
}

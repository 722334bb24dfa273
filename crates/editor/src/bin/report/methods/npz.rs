//! Arrays that NumPy wrote: `.npy` files within a zip archive.

use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use exr::prelude::f16;
use flate2::read::DeflateDecoder;

/// A row-major array.
#[derive(Debug, PartialEq)]
pub struct Array {
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// Values, whatever kind of number the file has.
    pub values: Vec<f32>,
}

/// Reads one array of an archive.
///
/// # Errors
/// If the file cannot be read, is no such archive, or has no such array.
pub fn read(path: &Path, name: &str) -> Result<Array> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    member(&bytes, &format!("{name}.npy"))
        .and_then(|npy| array(&npy))
        .with_context(|| format!("cannot read the array {name} of {}", path.display()))
}

/// One file of a zip archive, found through the directory at its end.
fn member(zip: &[u8], name: &str) -> Result<Vec<u8>> {
    const END: &[u8] = b"PK\x05\x06";
    let end = zip.windows(END.len()).rposition(|bytes| bytes == END).context("no directory of a zip archive")?;
    let (n_members, mut at) = (number(zip, end + 10, 2)?, number(zip, end + 16, 4)?);
    for _ in 0..n_members {
        let [name_len, extra_len, comment_len] = [28, 30, 32].map(|offset| number(zip, at + offset, 2));
        let name_end = at + 46 + name_len?;
        if zip.get(at + 46..name_end) == Some(name.as_bytes()) {
            return unpacked(zip, at);
        }
        at = name_end + extra_len? + comment_len?;
    }
    bail!("there is no {name}")
}

/// The content of the file whose entry in the directory begins there.
fn unpacked(zip: &[u8], entry: usize) -> Result<Vec<u8>> {
    let (method, packed_len, len) =
        (number(zip, entry + 10, 2)?, number(zip, entry + 20, 4)?, number(zip, entry + 24, 4)?);
    let local = number(zip, entry + 42, 4)?;
    // Names and further fields may be of another length here than in the directory.
    let start = local + 30 + number(zip, local + 26, 2)? + number(zip, local + 28, 2)?;
    let packed = zip.get(start..start + packed_len).context("the archive is cut off, or larger than 4 GB")?;
    match method {
        0 => Ok(packed.to_vec()),
        8 => {
            let mut content = Vec::new();
            DeflateDecoder::new(packed).take(len as u64 + 1).read_to_end(&mut content)?;
            ensure!(content.len() == len, "{} bytes are there, {len} were told", content.len());
            Ok(content)
        }
        other => bail!("packed by method {other}; write the archive with numpy.savez or numpy.savez_compressed"),
    }
}

/// A little-endian number of a few bytes.
fn number(bytes: &[u8], at: usize, len: usize) -> Result<usize> {
    let bytes = bytes.get(at..at + len).context("the archive is cut off")?;
    Ok(bytes.iter().rev().fold(0, |number, &byte| number << 8 | usize::from(byte)))
}

/// An array of 16-, 32- or 64-bit numbers, little-endian and row by row.
fn array(npy: &[u8]) -> Result<Array> {
    ensure!(npy.starts_with(b"\x93NUMPY"), "not a file of NumPy");
    let (len_bytes, first) = if npy.get(6) == Some(&1) { (2, 10) } else { (4, 12) };
    let start = first + number(npy, 8, len_bytes)?;
    let head = std::str::from_utf8(npy.get(first..start).context("the array ends in its head")?)?;
    ensure!(head.contains("'fortran_order': False"), "the array is stored column by column");
    let shape = head.split_once("'shape': (").and_then(|(_, rest)| rest.split_once(')')).context("no shape")?.0;
    let axes = shape.split(',').map(str::trim).filter(|axis| !axis.is_empty());
    let shape = axes.map(str::parse).collect::<Result<Vec<usize>, _>>()?;
    let content = &npy[start..];
    let values: Vec<f32> = match head.split_once("'descr': '").and_then(|(_, rest)| rest.split_once('\'')) {
        Some(("<f2", _)) => content.as_chunks().0.iter().map(|&bytes| f16::from_le_bytes(bytes).to_f32()).collect(),
        Some(("<f4", _)) => content.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect(),
        Some(("<f8", _)) => content.as_chunks().0.iter().map(|&bytes| f64::from_le_bytes(bytes) as f32).collect(),
        other => bail!("numbers of kind {:?}; there are <f2, <f4 and <f8", other.map(|(kind, _)| kind)),
    };
    ensure!(values.len() == shape.iter().product::<usize>(), "{} values do not fill {shape:?}", values.len());
    Ok(Array { shape, values })
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::{Compression, write::DeflateEncoder};

    use super::*;

    fn npy(kind: &str, shape: &str, content: &[u8]) -> Vec<u8> {
        let head = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n");
        [b"\x93NUMPY\x01\x00", (head.len() as u16).to_le_bytes().as_slice(), head.as_bytes(), content].concat()
    }

    /// An archive of packed files.
    fn zip(files: &[(&str, &[u8])]) -> Vec<u8> {
        let (mut out, mut directory) = (Vec::new(), Vec::new());
        for (name, content) in files {
            let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
            encoder.write_all(content).unwrap();
            let packed = encoder.finish().unwrap();
            let sizes = [0, packed.len() as u32, content.len() as u32].map(u32::to_le_bytes).concat();
            let local = (out.len() as u32).to_le_bytes();
            // Four more bytes in the local header, as NumPy writes them.
            out.extend(
                [b"PK\x03\x04".as_slice(), &[0; 4], &[8, 0, 0, 0, 0, 0], &sizes, &[name.len() as u8, 0, 4, 0]].concat(),
            );
            out.extend([name.as_bytes(), &[0; 4], &packed].concat());
            directory.extend([b"PK\x01\x02".as_slice(), &[0; 6], &[8, 0, 0, 0, 0, 0], &sizes].concat());
            directory.extend([&[name.len() as u8, 0], [0; 12].as_slice(), &local, name.as_bytes()].concat());
        }
        let (n, at, len) = (files.len() as u8, out.len() as u32, directory.len() as u32);
        out.extend(directory);
        out.extend([b"PK\x05\x06".as_slice(), &[0, 0, 0, 0, n, 0, n, 0]].concat());
        out.extend([len.to_le_bytes(), at.to_le_bytes()].concat());
        out.extend([0, 0]);
        out
    }

    #[test]
    fn arrays_are_read_by_name() {
        let halves: Vec<u8> = [1.0, -0.5, 2.0, 1024.0].map(|x| f16::from_f32(x).to_le_bytes()).concat();
        let singles: Vec<u8> = [0.1f32, 7.0].map(f32::to_le_bytes).concat();
        let archive = zip(&[("T.npy", &npy("<f2", "(2, 2)", &halves)), ("guide.npy", &npy("<f4", "(2,)", &singles))]);
        let read = |name: &str| member(&archive, name).and_then(|npy| array(&npy));
        assert_eq!(read("T.npy").unwrap(), Array { shape: vec![2, 2], values: vec![1.0, -0.5, 2.0, 1024.0] });
        assert_eq!(read("guide.npy").unwrap(), Array { shape: vec![2], values: vec![0.1, 7.0] });
        assert!(read("other.npy").is_err());
    }

    #[test]
    fn damaged_archives_are_refused() {
        let archive = zip(&[("T.npy", &npy("<f4", "(3,)", &[0; 12]))]);
        // The last two bytes are the length of a comment that nobody reads.
        for len in 0..archive.len() - 2 {
            assert!(member(&archive[..len], "T.npy").is_err(), "{len}");
        }
        for bad in [npy("<f4", "(4,)", &[0; 12]), npy("<i4", "(3,)", &[0; 12]), b"nothing".to_vec()] {
            assert!(array(&bad).is_err());
        }
    }
}

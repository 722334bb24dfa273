//! Sizes of memory and files in words: the window and the command line say them alike.

/// A number of bytes for people.
pub fn bytes_words(bytes: u64) -> String {
    match bytes as f64 {
        b if b < 1e3 => format!("{b:.0} B"),
        b if b < 1e6 => format!("{:.1} kB", b / 1e3),
        b if b < 1e9 => format!("{:.1} MB", b / 1e6),
        b => format!("{:.2} GB", b / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_read_in_the_unit_that_fits() {
        let sizes = [0, 999, 5_000, 2_500_000, 3_000_000_000].map(bytes_words);
        assert_eq!(sizes, ["0 B", "999 B", "5.0 kB", "2.5 MB", "3.00 GB"]);
    }
}

//! Where the sun stands, after \[Blanco2001\], and how large it is.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::SkyError;

/// Half of the angle under which the sun is seen: 0.2665°.
pub const SUN_RADIUS_RAD: f64 = 0.2665 * std::f64::consts::PI / 180.0;

/// Solid angle of the sun's disk.
pub fn sun_solid_angle() -> f64 {
    std::f64::consts::TAU * (1.0 - SUN_RADIUS_RAD.cos())
}

/// A place and a moment.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SunTime {
    /// Year, month 1…12, day 1…31 of the Gregorian calendar, local.
    pub date: (i32, u32, u32),
    /// Local time in hours since midnight.
    pub hour: f64,
    /// Local time minus universal time in hours.
    pub utc_offset_h: f64,
    /// Positive in the north.
    pub latitude_deg: f64,
    /// Positive in the east.
    pub longitude_deg: f64,
}

/// Where the sun stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunPosition {
    /// From north over east.
    pub azimuth_deg: f64,
    /// Above the horizon.
    pub elevation_deg: f64,
}

impl SunTime {
    /// Checks that date, time and place exist.
    ///
    /// # Errors
    /// [`SkyError::Setting`] with the range.
    pub fn check(&self) -> Result<(), SkyError> {
        let complain = |what: &str| Err(SkyError::Setting(what.into()));
        let (year, month, day) = self.date;
        if !(1901..=2099).contains(&year) || !(1..=12).contains(&month) || !(1..=n_days(year, month)).contains(&day) {
            return complain("the date of the sun must exist and lie in the years 1901 to 2099");
        }
        if !(0.0..=24.0).contains(&self.hour) || !(-14.0..=14.0).contains(&self.utc_offset_h) {
            return complain("the time of the sun must be 00:00 to 24:00, its offset −14 to 14 hours");
        }
        if !(-90.0..=90.0).contains(&self.latitude_deg) || !(-180.0..=180.0).contains(&self.longitude_deg) {
            return complain("the latitude must be −90 to 90 degrees, the longitude −180 to 180");
        }
        Ok(())
    }

    /// Where the sun stands, without refraction; exact to half a minute of arc from 1999 to 2015 and to a few minutes
    /// for a century around.
    pub fn position(&self) -> SunPosition {
        let hour_utc = self.hour - self.utc_offset_h;
        let n = days_since_2000(self.date) + hour_utc / 24.0;
        // Ecliptic coordinates of the sun, then right ascension and declination.
        let omega = 2.1429 - 0.001_039_459_4 * n;
        let mean_longitude = 4.895_063_0 + 0.017_202_791_698 * n;
        let anomaly = 6.240_060_0 + 0.017_201_969_9 * n;
        let longitude = mean_longitude + 0.033_416_07 * anomaly.sin() + 0.000_348_94 * (2.0 * anomaly).sin()
            - 0.000_113_4
            - 0.000_020_3 * omega.sin();
        let obliquity = 0.409_092_8 - 6.2140e-9 * n + 0.000_039_6 * omega.cos();
        let right_ascension = (obliquity.cos() * longitude.sin()).atan2(longitude.cos());
        let declination = (obliquity.sin() * longitude.sin()).asin();
        // Sidereal time turns them to the horizon.
        let greenwich_h = 6.697_424_324_2 + 0.065_709_828_3 * n + hour_utc;
        let hour_angle = (greenwich_h * 15.0 + self.longitude_deg).to_radians() - right_ascension;
        let latitude = self.latitude_deg.to_radians();
        let cos_zenith = latitude.cos() * hour_angle.cos() * declination.cos() + declination.sin() * latitude.sin();
        let azimuth = (-hour_angle.sin()).atan2(declination.tan() * latitude.cos() - latitude.sin() * hour_angle.cos());
        let zenith = cos_zenith.clamp(-1.0, 1.0).acos();
        let parallax = 6371.01 / 149_597_890.0 * zenith.sin();
        SunPosition {
            azimuth_deg: azimuth.to_degrees().rem_euclid(360.0),
            elevation_deg: 90.0 - (zenith + parallax).to_degrees(),
        }
    }
}

/// Unit vector towards an azimuth (from −Z over +X) and an elevation.
pub fn sun_direction(position: SunPosition) -> Vec3 {
    let (sin_azimuth, cos_azimuth) = position.azimuth_deg.to_radians().sin_cos();
    let (sin_elevation, cos_elevation) = position.elevation_deg.to_radians().sin_cos();
    glam::DVec3::new(sin_azimuth * cos_elevation, sin_elevation, -cos_azimuth * cos_elevation).as_vec3()
}

/// Days of a month, 1…12.
pub fn n_days(year: i32, month: u32) -> u32 {
    match month {
        2 if year % 4 == 0 && (year % 100 != 0 || year % 400 == 0) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// Days from noon of January 1st 2000 to the midnight that begins a date.
fn days_since_2000((year, month, day): (i32, u32, u32)) -> f64 {
    let before: u32 = (1..month).map(|m| n_days(year, m)).sum();
    // Every fourth year from 1901 to 2099 is a leap year.
    let (years, leaps) = (year - 2000, (year - 2001).div_euclid(4) + 1);
    f64::from(years * 365 + leaps) + f64::from(before + day - 1) - 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    fn highest(date: (i32, u32, u32), latitude_deg: f64) -> SunPosition {
        let at = |minute: u32| SunTime {
            date,
            hour: f64::from(minute) / 60.0,
            utc_offset_h: 0.0,
            latitude_deg,
            longitude_deg: 0.0,
        };
        let positions = (0..1440).map(|minute| at(minute).position());
        positions.max_by(|a, b| a.elevation_deg.total_cmp(&b.elevation_deg)).unwrap()
    }

    #[test]
    fn days_are_counted_over_leap_years() {
        assert_eq!(days_since_2000((2000, 1, 1)), -0.5);
        assert_eq!(days_since_2000((2000, 3, 1)), 59.5);
        assert_eq!(days_since_2000((2001, 1, 1)), 365.5);
        assert_eq!(days_since_2000((1999, 12, 31)), -1.5);
        assert_eq!(days_since_2000((2026, 6, 21)), 9667.5);
    }

    #[test]
    fn the_sun_culminates_where_the_calendar_says() {
        // 90° at the equator on the equinox; 90° − latitude ± 23.44° on the solstices.
        assert!((highest((2026, 3, 20), 0.0).elevation_deg - 90.0).abs() < 0.3);
        let summer = highest((2026, 6, 21), 45.0);
        assert!((summer.elevation_deg - 68.44).abs() < 0.03, "{summer:?}");
        assert!((summer.azimuth_deg - 180.0).abs() < 1.0, "south at noon: {summer:?}");
        assert!((highest((2026, 12, 21), 45.0).elevation_deg - 21.56).abs() < 0.03);
        let down_under = highest((2026, 12, 21), -45.0);
        assert!(down_under.azimuth_deg < 1.0 || down_under.azimuth_deg > 359.0, "north at noon: {down_under:?}");
    }

    #[test]
    fn the_sun_stands_where_the_literature_says() {
        // [Reda2004, appendix A.5]: Golden, Colorado. Its table refracts by 0.0163°; the position has no refraction.
        let golden = SunTime {
            date: (2003, 10, 17),
            hour: 12.0 + 30.5 / 60.0,
            utc_offset_h: -7.0,
            latitude_deg: 39.742_476,
            longitude_deg: -105.1786,
        };
        let at = golden.position();
        assert!((at.azimuth_deg - 194.340_24).abs() < 0.01, "{at:?}");
        assert!((at.elevation_deg - (90.0 - 50.111_62 - 0.016_33)).abs() < 0.01, "{at:?}");
        // [Meeus1998, example 25.a]: a declination of −7.785° at 0 h dynamical time, a minute before universal time. From
        // the pole the sun stands as high as its declination, less its parallax of 8.8 seconds of arc.
        let pole =
            SunTime { date: (1992, 10, 13), hour: 0.0, utc_offset_h: 0.0, latitude_deg: 90.0, longitude_deg: 0.0 };
        let declination = pole.position().elevation_deg + 8.8 / 3600.0;
        assert!((declination + 7.785).abs() < 0.01, "{declination}");
    }

    #[test]
    fn the_morning_sun_stands_in_the_east_and_offsets_shift_the_clock() {
        let noon_east =
            SunTime { date: (2026, 3, 20), hour: 9.0, utc_offset_h: 3.0, latitude_deg: 0.0, longitude_deg: 0.0 };
        let position = noon_east.position();
        assert!((position.azimuth_deg - 90.0).abs() < 1.0 && position.elevation_deg < 2.0, "{position:?}");
        assert!((sun_direction(position) - Vec3::X).length() < 0.05);
        assert!(SunTime { date: (2026, 2, 29), ..noon_east }.check().is_err());
        assert!(SunTime { date: (2024, 2, 29), ..noon_east }.check().is_ok());
        assert!(SunTime { hour: f64::NAN, ..noon_east }.check().is_err());
    }

    #[test]
    fn the_disk_of_the_sun_has_its_solid_angle() {
        assert!((sun_solid_angle() - 6.797e-5).abs() < 1e-8, "{}", sun_solid_angle());
    }
}

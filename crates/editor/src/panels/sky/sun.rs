//! Where the sun stands: by angle, or by date, time and place, with a day that plays.

use clerestory_transport::sky::{
    DEFAULT_TURBIDITY, SkyLight, SkySetting, SunPlace, SunPosition, SunSetting, SunTime, n_days,
};
use eframe::egui::{Button, ComboBox, Grid, RichText, Slider, SliderClamping, Ui};

use crate::panels::number::{Number, Spelling, number_of, slider_ui};

/// A sun in the morning that nobody has moved yet.
pub const NEW_SUN: SunSetting = SunSetting {
    place: SunPlace::Angles { azimuth_deg: 135.0, elevation_deg: 40.0 },
    turbidity: DEFAULT_TURBIDITY,
    intensity: 1.0,
};
/// Greenwich on a morning in summer.
const NEW_TIME: SunTime =
    SunTime { date: (2026, 6, 21), hour: 10.0, utc_offset_h: 0.0, latitude_deg: 51.48, longitude_deg: 0.0 };

const MONTHS: [&str; 12] = [
    "January",
    "February",
    "March",
    "April",
    "May",
    "June",
    "July",
    "August",
    "September",
    "October",
    "November",
    "December",
];
const WINDS: [&str; 8] = ["north", "northeast", "east", "southeast", "south", "southwest", "west", "northwest"];

/// A sun where that of a sky stands now, or a new one.
pub(super) fn sun_of(light: &SkyLight) -> SunSetting {
    light.sun.map_or(NEW_SUN, |sun| {
        let d = sun.direction.as_dvec3();
        let (azimuth, elevation) = (d.x.atan2(-d.z).to_degrees().rem_euclid(360.0), d.y.asin().to_degrees());
        SunSetting::by_angles(tidy(azimuth), tidy(elevation))
    })
}

/// Two decimals: more would only be noise in files.
pub(super) fn tidy(degrees: f64) -> f64 {
    (100.0 * degrees).round() / 100.0
}

/// Draws it, if there is a sun; `playing` is the hour while the day plays, `before` what was set by time.
pub(super) fn sun_ui(
    ui: &mut Ui,
    sky: &mut SkySetting,
    (playing, before): (&mut Option<f64>, &mut Option<(SunTime, f64)>),
) {
    let Some(sun) = &mut sky.sun else {
        *playing = None;
        return;
    };
    ui.add_space(2.0);
    place_choice_ui(ui, sun, before);
    match &mut sun.place {
        SunPlace::Angles { azimuth_deg, elevation_deg } => {
            *playing = None;
            ui.horizontal(|ui| {
                ui.label("Azimuth");
                let number = Number::new(azimuth_deg).speed(0.5).max_decimals(2).suffix("°");
                let number = ui.add(number).on_hover_text("From north, −Z, over east, +X, degrees");
                if number.accessible_name("Azimuth of the sun").changed() {
                    *azimuth_deg = azimuth_deg.rem_euclid(360.0);
                }
                ui.label("Elevation");
                let number = Number::new(elevation_deg).range(-90.0..=90.0).speed(0.2).max_decimals(2).suffix("°");
                ui.add(number).on_hover_text("Above the horizon, degrees").accessible_name("Elevation of the sun");
            });
        }
        SunPlace::Time { time, north_deg } => time_ui(ui, (time, north_deg), playing),
    }
    ui.horizontal(|ui| {
        ui.label("Haze");
        // What a look says more exactly stays.
        let slider = Slider::new(&mut sun.turbidity, 2.0..=10.0).max_decimals(1).clamping(SliderClamping::Edits);
        let haze = slider_ui(ui, slider, Spelling::default());
        haze.on_hover_text("Turbidity: 2 is very clear, 10 is hazy").accessible_name("Haze");
        let speed = (0.01 * f64::from(sun.intensity)).max(1e-3);
        let number = Number::new(&mut sun.intensity).range(0.0..=1e9).speed(speed).max_decimals(3).suffix("×");
        ui.add(number).on_hover_text("Multiplies the sun alone").accessible_name("Intensity of the sun");
    });
    let north_deg = if let SunPlace::Time { north_deg, .. } = sun.place { north_deg } else { 0.0 };
    if let Ok(position) = sun.position() {
        ui.label(RichText::new(position_words(position, north_deg)).weak());
    }
}

/// By angle, or by time.
fn place_choice_ui(ui: &mut Ui, sun: &mut SunSetting, before: &mut Option<(SunTime, f64)>) {
    ui.horizontal(|ui| {
        let by_time = matches!(sun.place, SunPlace::Time { .. });
        ui.label("Sun");
        let by_angle = ui.selectable_label(!by_time, "By angle");
        if by_angle.on_hover_text("Azimuth and elevation").clicked()
            && let (SunPlace::Time { time, north_deg }, Ok(position)) = (sun.place, sun.position())
        {
            *before = Some((time, north_deg));
            let (azimuth_deg, elevation_deg) = (tidy(position.azimuth_deg), tidy(position.elevation_deg));
            sun.place = SunPlace::Angles { azimuth_deg, elevation_deg };
        }
        let by_date = ui.selectable_label(by_time, "By date and place");
        if by_date.on_hover_text("Where it stands at a time on Earth").clicked() && !by_time {
            let (time, north_deg) = before.unwrap_or((NEW_TIME, 0.0));
            sun.place = SunPlace::Time { time, north_deg };
        }
    });
}

/// Date, time, place and north.
fn time_ui(ui: &mut Ui, (time, north_deg): (&mut SunTime, &mut f64), playing: &mut Option<f64>) {
    ui.horizontal(|ui| {
        let words = if playing.is_some() { "Pause" } else { "Play" };
        let play = ui.add(Button::new(words)).on_hover_text("Lets an hour pass in a second");
        if play.accessible_name("Play the day").clicked() {
            *playing = if playing.is_some() { None } else { Some(time.hour) };
        }
        let mut minutes = (60.0 * time.hour).round();
        ui.spacing_mut().slider_width = (ui.available_width() - 64.0).max(80.0);
        let clock = |minutes: f64, _| {
            let minutes = minutes.round() as u32;
            format!("{:02}:{:02}", minutes / 60, minutes % 60)
        };
        let slider = Slider::new(&mut minutes, 0.0..=24.0 * 60.0).step_by(1.0);
        let slider = slider_ui(ui, slider, Spelling::new(clock, parsed_minutes)).on_hover_text("Local time");
        if slider.accessible_name("Time of day").changed() {
            (time.hour, *playing) = (minutes / 60.0, None);
        }
    });
    Grid::new("sun time").num_columns(2).spacing([10.0, 5.0]).show(ui, |ui| {
        ui.label("Date");
        ui.horizontal(|ui| date_ui(ui, &mut time.date));
        ui.end_row();
        ui.label("Place");
        ui.horizontal(|ui| {
            let latitude = Number::new(&mut time.latitude_deg).range(-90.0..=90.0).speed(0.1).max_decimals(4);
            ui.add(latitude.suffix("° N")).on_hover_text("Latitude, south is negative").accessible_name("Latitude");
            let longitude = Number::new(&mut time.longitude_deg).range(-180.0..=180.0).speed(0.1).max_decimals(4);
            ui.add(longitude.suffix("° E")).on_hover_text("Longitude, west is negative").accessible_name("Longitude");
        });
        ui.end_row();
        ui.label("Clock");
        ui.horizontal(|ui| {
            let offset = Number::new(&mut time.utc_offset_h).range(-14.0..=14.0).speed(0.05).max_decimals(2);
            ui.add(offset.prefix("UTC + ").suffix(" h"))
                .on_hover_text("Local time less universal time, hours; with summer time one more")
                .accessible_name("Offset from universal time");
            ui.label("North");
            let north = Number::new(north_deg).range(-360.0..=360.0).speed(0.5).max_decimals(1).suffix("°");
            ui.add(north).on_hover_text("Azimuth of north in the scene: 0° is −Z, 90° is +X").accessible_name("North");
        });
        ui.end_row();
    });
}

fn date_ui(ui: &mut Ui, (year, month, day): &mut (i32, u32, u32)) {
    let number = Number::new(day).range(1..=n_days(*year, *month)).speed(0.1);
    ui.add(number).on_hover_text("Day of the month").accessible_name("Day");
    let name = |month: u32| MONTHS.get(month as usize - 1).copied().unwrap_or_default();
    let combo = ComboBox::from_id_salt("month").width(92.0).selected_text(name(*month)).show_ui(ui, |ui| {
        for nth in 1..=12 {
            ui.selectable_value(month, nth, name(nth));
        }
    });
    combo.response.accessible_name("Month");
    let number = Number::new(year).range(1901..=2099).speed(0.1).words(|year, _| format!("{year:.0}"));
    ui.add(number).on_hover_text("Year").accessible_name("Year");
    *day = (*day).min(n_days(*year, *month));
}

/// Minutes since midnight of `14:30`, or of hours.
fn parsed_minutes(text: &str) -> Option<f64> {
    match text.split_once(':') {
        Some((hours, minutes)) => Some(60.0 * number_of(hours, "")? + number_of(minutes, "")?),
        None => Some(60.0 * number_of(text, "")?),
    }
}

/// Where the sun stands, by the wind as it is called where north has an azimuth, and by its own in the scene.
fn position_words(position: SunPosition, north_deg: f64) -> String {
    let SunPosition { azimuth_deg, elevation_deg } = position;
    if elevation_deg <= 0.0 {
        return format!("The sun is {:.1}° below the horizon", -elevation_deg);
    }
    let wind = WINDS[((azimuth_deg - north_deg).rem_euclid(360.0) / 45.0).round() as usize % 8];
    format!("In the {wind}, azimuth {azimuth_deg:.1}°, {elevation_deg:.1}° high")
}

#[cfg(test)]
mod tests {
    use clerestory_transport::sky::{Environment, Sun, sun_direction};
    use glam::Vec3;

    use super::*;

    #[test]
    fn a_sun_is_taken_over_where_it_stands() {
        let direction = sun_direction(SunPosition { azimuth_deg: 210.0, elevation_deg: 35.5 });
        let sun = Sun { direction, illuminance_lx: 1.0, color: Vec3::ONE };
        let light = SkyLight { sun: Some(sun), ..SkyLight::new("uniform", Environment::uniform(Vec3::ONE)) };
        assert_eq!(sun_of(&light).place, SunPlace::Angles { azimuth_deg: 210.0, elevation_deg: 35.5 });
        assert_eq!(sun_of(&SkyLight { sun: None, ..light }), NEW_SUN);
    }

    #[test]
    fn times_are_read_as_people_write_them() {
        let read = ["14:30", "9", "6.5", "6,5", " 0:05 "].map(parsed_minutes);
        assert_eq!(read, [870.0, 540.0, 390.0, 390.0, 5.0].map(Some));
        assert_eq!(["noon", "nan", "inf", "nan:30", "9:nan"].map(parsed_minutes), [None; 5]);
    }

    #[test]
    fn a_place_is_told_by_the_wind() {
        let at = |azimuth_deg, elevation_deg, north_deg| {
            position_words(SunPosition { azimuth_deg, elevation_deg }, north_deg)
        };
        assert_eq!(at(359.0, 10.0, 0.0), "In the north, azimuth 359.0°, 10.0° high");
        assert_eq!(at(92.0, 10.0, 0.0), "In the east, azimuth 92.0°, 10.0° high");
        assert_eq!(at(270.0, 10.0, 90.0), "In the south, azimuth 270.0°, 10.0° high", "north is on the right");
        assert_eq!(at(0.0, -6.0, 0.0), "The sun is 6.0° below the horizon");
    }
}

//! Measured lamp profiles: luminous intensity by direction, from files that makers of lamps give away.

mod ies;
mod ldt;
#[cfg(test)]
mod tests;

use crate::math::{DVec3, Distribution, Stream};
use crate::{Error, Result};
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// Relative intensity by the angle θ to the lamp's axis and the angle φ about it: bilinear in both between measured directions, nothing
/// beyond the first and the last θ. Its largest value is 1. Directions have a z along the axis, and φ = 0 along x.
#[derive(Clone, Debug)]
pub struct Profile {
    /// θ in radians, ascending, at least two.
    thetas: Vec<f64>,
    /// φ in radians, ascending from 0 to 2π.
    phis: Vec<f64>,
    /// For each φ those of all θ.
    values: Vec<f64>,
    /// Cells between four directions, by what they send: those of one φ after the other.
    cells: Distribution,
    /// The largest θ with light.
    widest: f64,
}

/// What a file says: angles in degrees, and intensities of any scale for each horizontal angle at all vertical ones.
struct Measured {
    vertical: Vec<f64>,
    horizontal: Vec<f64>,
    values: Vec<f64>,
}

/// Larger files are no lamp's.
const MOST_BYTES: u64 = 16 << 20;
/// More directions than these are no measurement's.
const MOST_VALUES: usize = 1 << 20;

impl Profile {
    /// Reads an IESNA LM-63 file, or a EULUMDAT file if its name ends in `.ldt`.
    ///
    /// # Errors
    /// [`Error::Asset`] for what cannot be read or understood, with its line.
    pub fn read(path: impl AsRef<Path>) -> Result<Profile> {
        let path = path.as_ref();
        let fail = |error: std::io::Error| Error::asset(path, format!("cannot read the lamp's profile: {error}"));
        let metadata = std::fs::metadata(path).map_err(fail)?;
        if !metadata.is_file() || metadata.len() > MOST_BYTES {
            return Err(Error::asset(
                path,
                "cannot read the lamp's profile: this is no file, or one of more than 16 MiB",
            ));
        }
        let bytes = std::fs::read(path).map_err(fail)?;
        let is_ldt = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("ldt"));
        Profile::parse(&bytes, is_ldt).map_err(|message| Error::asset(path, message))
    }

    /// The profile in the bytes of a file.
    fn parse(bytes: &[u8], is_ldt: bool) -> Result<Profile, String> {
        // Makers' names may be in any encoding.
        let text = String::from_utf8_lossy(bytes);
        Profile::new(if is_ldt { ldt::parse(&text) } else { ies::parse(&text) }?)
    }

    fn new(measured: Measured) -> Result<Profile, String> {
        let Measured { vertical, values, .. } = &measured;
        ascending(vertical, "vertical")?;
        if vertical.len() < 2 || vertical[0] < 0.0 || vertical[vertical.len() - 1] > 180.0 {
            return Err(format!(
                "has vertical angles from {} to {}; expected at least two from 0 to 180 degrees",
                vertical[0],
                vertical[vertical.len() - 1]
            ));
        }
        if let Some(wrong) = values.iter().find(|value| !(0.0..=f64::MAX).contains(*value)) {
            return Err(format!("holds an intensity of {wrong}; expected finite numbers, at least 0"));
        }
        let most = values.iter().fold(0.0, |most: f64, value| most.max(*value));
        if most <= 0.0 {
            return Err("is dark: all its intensities are 0".to_string());
        }
        let (planes, order) = all_around(&measured.horizontal)?;
        let count = vertical.len();
        let row = |plane: usize| values[plane * count..(plane + 1) * count].iter().map(|value| value / most);
        let values: Vec<f64> = order.into_iter().flat_map(row).collect();
        let thetas: Vec<f64> = vertical.iter().map(|angle| angle.to_radians().min(PI)).collect();
        let mut phis: Vec<f64> = planes.into_iter().map(f64::to_radians).collect();
        phis[0] = 0.0;
        *phis.last_mut().ok_or("has no horizontal angle")? = TAU;

        // What cells send, and where there is light at all.
        let mut profile = Profile { thetas, phis, values, cells: Distribution::default(), widest: 0.0 };
        let cell = |index: usize| profile.columns(index).iter().sum::<f64>() * 0.5 * profile.turn(index);
        let cells = Distribution::new((0..(profile.phis.len() - 1) * (count - 1)).map(cell));
        let lit = |theta: &usize| profile.values.iter().skip(*theta).step_by(count).any(|value| *value > 0.0);
        let last = (0..count).rev().find(lit).unwrap_or(0);
        profile.widest = profile.thetas[(last + 1).min(count - 1)];
        profile.cells = cells;
        if profile.cells.is_empty() {
            return Err("is dark: its intensities come to nothing".to_string());
        }
        Ok(profile)
    }

    /// ∫ intensity dω.
    pub fn total(&self) -> f64 {
        self.cells.total()
    }

    /// No direction at a larger angle to the axis has any light.
    pub fn widest(&self) -> f64 {
        self.widest
    }

    /// The relative intensity in a direction.
    pub fn at(&self, direction: DVec3) -> f64 {
        let theta = direction.x.hypot(direction.y).atan2(direction.z);
        let phi = direction.y.atan2(direction.x).rem_euclid(TAU);
        if theta < self.thetas[0] || theta > self.thetas[self.thetas.len() - 1] {
            return 0.0;
        }
        let between = |angles: &[f64], angle: f64| {
            let i = (angles.partition_point(|a| *a <= angle)).clamp(1, angles.len() - 1) - 1;
            (i, ((angle - angles[i]) / (angles[i + 1] - angles[i])).clamp(0.0, 1.0))
        };
        let ((i, s), (j, t)) = (between(&self.thetas, theta), between(&self.phis, phi));
        let along = |plane: usize| {
            let at = plane * self.thetas.len() + i;
            self.values[at] + s * (self.values[at + 1] - self.values[at])
        };
        along(j) + t * (along(j + 1) - along(j))
    }

    /// A direction drawn in proportion to the intensity: a cell by what it sends, φ by what the cell sends at each, θ by the rest.
    pub fn sample(&self, stream: &mut Stream) -> DVec3 {
        let [u, v] = stream.uniform2();
        // A profile sends something: there is a choice.
        let Some(choice) = self.cells.choose(u) else { return DVec3::Z };
        let [left, right] = self.columns(choice.index);
        // Of a density that goes evenly from one value to another.
        let root = (left * left * (1.0 - choice.rest) + right * right * choice.rest).sqrt();
        let t = (choice.rest * (left + right) / (left + root)).clamp(0.0, 1.0);
        let (i, j) = self.place(choice.index);
        let phi = self.phis[j] + t * (self.phis[j + 1] - self.phis[j]);
        let at = |i: usize| {
            let [a, b] = [j, j + 1].map(|plane| self.values[plane * self.thetas.len() + i]);
            a + t * (b - a)
        };
        let slope =
            Slope { from: self.thetas[i], length: self.thetas[i + 1] - self.thetas[i], ends: [at(i), at(i + 1)] };
        let theta = slope.from + slope.invert(v);
        let ((sin, cos), (sin_phi, cos_phi)) = (theta.sin_cos(), phi.sin_cos());
        DVec3::new(sin * cos_phi, sin * sin_phi, cos).normalize()
    }

    /// The first of θ and of φ of a cell.
    fn place(&self, cell: usize) -> (usize, usize) {
        (cell % (self.thetas.len() - 1), cell / (self.thetas.len() - 1))
    }

    /// By how much φ differs over a cell.
    fn turn(&self, cell: usize) -> f64 {
        let (_, j) = self.place(cell);
        self.phis[j + 1] - self.phis[j]
    }

    /// ∫ intensity sin θ dθ along the two sides of a cell.
    fn columns(&self, cell: usize) -> [f64; 2] {
        let (i, j) = self.place(cell);
        [j, j + 1].map(|plane| {
            let at = plane * self.thetas.len() + i;
            let ends = [self.values[at], self.values[at + 1]];
            let slope = Slope { from: self.thetas[i], length: self.thetas[i + 1] - self.thetas[i], ends };
            slope.sum(slope.length)
        })
    }
}

/// An intensity that goes evenly from one value to another over a range of θ.
struct Slope {
    from: f64,
    length: f64,
    ends: [f64; 2],
}

impl Slope {
    /// ∫ intensity sin θ dθ over the first `h` of it.
    fn sum(&self, h: f64) -> f64 {
        // Below, a difference would lose more digits than the next term of the series has.
        const SMALL: f64 = 1e-3;
        let ((sin_from, cos_from), (sin, cos)) = (self.from.sin_cos(), h.sin_cos());
        let below_one = 2.0 * (0.5 * h).sin().powi(2);
        // ∫ sin(from + x), ∫ x sin(from + x) by the sum's sine.
        let even = sin_from * sin + cos_from * below_one;
        let third = if h < SMALL { h * h * h * (1.0 / 3.0 - h * h / 30.0) } else { sin - h * cos };
        let rising = sin_from * (h * sin - below_one) + cos_from * third;
        (self.ends[0] * even + (self.ends[1] - self.ends[0]) * rising / self.length).max(0.0)
    }

    /// The `h` by which this share of the whole is reached: Newton's steps, or halves of what is left where they lead out of it.
    fn invert(&self, share: f64) -> f64 {
        const STEPS: usize = 64;
        let wanted = share * self.sum(self.length);
        let (mut low, mut high) = (0.0, self.length);
        let mut h = share * self.length;
        for _ in 0..STEPS {
            let off = self.sum(h) - wanted;
            if off > 0.0 {
                high = h
            } else {
                low = h
            }
            let steep = (self.ends[0] + (self.ends[1] - self.ends[0]) * h / self.length) * (self.from + h).sin();
            let next = h - off / steep;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if (next - h).abs() <= 1e-14 * self.length {
                return next;
            }
            h = next;
        }
        h
    }
}

fn ascending(angles: &[f64], which: &str) -> Result<(), String> {
    let Some(first) = angles.first() else { return Err(format!("has no {which} angle")) };
    if !angles.iter().all(|angle| angle.is_finite()) {
        return Err(format!("has a {which} angle that is not finite"));
    }
    match angles.windows(2).find(|pair| pair[1] - pair[0] < 1e-6) {
        None => Ok(()),
        Some(pair) => {
            Err(format!("has {which} angles from {first} on that do not grow: {} after {}", pair[1], pair[0]))
        }
    }
}

/// Horizontal angles all around, from 0 to 360, and for each of them that which was measured for it: by the symmetry that the
/// range of angles stands for.
fn all_around(angles: &[f64]) -> Result<(Vec<f64>, Vec<usize>), String> {
    ascending(angles, "horizontal")?;
    let (first, last, count) = (angles[0], angles[angles.len() - 1], angles.len());
    let mut planes: Vec<(f64, usize)> = angles.iter().copied().zip(0..).collect();
    // The other half of what is there, as in a mirror that holds this angle.
    let mirror = |planes: &mut Vec<(f64, usize)>, at: f64| {
        let others: Vec<_> = planes.iter().rev().map(|(angle, plane)| (2.0 * at - angle, *plane)).collect();
        planes.extend(others.into_iter().filter(|(angle, _)| *angle > at));
    };
    match (first, last) {
        _ if count == 1 => planes = vec![(0.0, 0), (360.0, 0)],
        (0.0, 90.0) => {
            mirror(&mut planes, 90.0);
            mirror(&mut planes, 180.0);
        }
        (0.0, 180.0) => mirror(&mut planes, 180.0),
        (90.0, 270.0) => {
            mirror(&mut planes, 270.0);
            // From 90 to 450: what is beyond a full turn comes first.
            let at = planes.iter().position(|(angle, _)| *angle >= 360.0).unwrap_or(planes.len());
            let (before, beyond) = planes.split_at(at);
            let beyond = beyond.iter().map(|(angle, plane)| (angle - 360.0, *plane)).filter(|(angle, _)| *angle < 90.0);
            planes = beyond.chain(before.iter().copied()).collect();
            close(&mut planes);
        }
        (0.0, last) if last > 180.0 && last <= 360.0 => close(&mut planes),
        _ => {
            return Err(format!(
                "has horizontal angles from {first} to {last}; expected them from 0 to 90, to 180, or all around, or from 90 to 270"
            ));
        }
    }
    Ok(planes.into_iter().unzip())
}

/// Lets planes begin at 0 and end at 360, where the first is met again.
fn close(planes: &mut Vec<(f64, usize)>) {
    let (first, last) = (planes[0], planes[planes.len() - 1]);
    if first.0 > 0.0 {
        // Symmetric about 0 as about 180: the nearest plane stands for it.
        planes.insert(0, (0.0, first.1));
    }
    if last.0 < 360.0 {
        planes.push((360.0, planes[0].1));
    }
}

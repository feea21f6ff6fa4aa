//! `transform`: a list of steps, the first applied first.

use crate::math::{DAffine3, DMat4, DVec3};
use crate::scene::table::{Item, Read, Table};

/// The composition of all steps; invertible.
pub(super) fn transform(item: &Item) -> Read<DAffine3> {
    let steps = item.array("a list of steps, for example [{ scale = 2.0 }, { translate = [0, 1, 0] }]")?;
    let steps = super::all(&steps, |item| step(&item.table()?))?;
    let whole = steps.iter().fold(DAffine3::IDENTITY, |before, step| *step * before);
    if is_invertible(&whole) { Ok(whole) } else { Err(item.fail(NOT_INVERTIBLE)) }
}

/// What is wrong with a transform that fails [`is_invertible`].
pub(super) const NOT_INVERTIBLE: &str =
    "cannot be inverted in 64-bit numbers; expected a transform that flattens nothing";

/// Whether a transform and its inverse are finite.
pub(super) fn is_invertible(transform: &DAffine3) -> bool {
    let determinant = transform.matrix3.determinant();
    determinant != 0.0 && determinant.is_finite() && transform.is_finite() && transform.inverse().is_finite()
}

fn step(table: &Table) -> Read<DAffine3> {
    let scale = table.get("scale", scale);
    let rotate = table.get("rotate", |item| rotate(&item.table()?));
    let translate = table.get("translate", |item| Ok(DAffine3::from_translation(item.vector()?)));
    let matrix = table.get("matrix", matrix);
    table.finish()?;
    let given: Vec<DAffine3> = [scale?, rotate?, translate?, matrix?].into_iter().flatten().collect();
    match given.as_slice() {
        [only] => Ok(*only),
        _ => Err(table.fail(format!(
            "found {} of `scale`, `rotate`, `translate` and `matrix`; expected exactly one in each step",
            given.len()
        ))),
    }
}

fn scale(item: &Item) -> Read<DAffine3> {
    let factors = if item.is_number() { DVec3::splat(item.number()?) } else { item.vector()? };
    if factors.cmpeq(DVec3::ZERO).any() {
        return Err(item.expected("factors other than 0"));
    }
    Ok(DAffine3::from_scale(factors))
}

fn rotate(table: &Table) -> Read<DAffine3> {
    let axis = table.require("axis", Item::direction);
    let angle = table.require("angle", Item::number);
    table.finish()?;
    Ok(DAffine3::from_axis_angle(axis?, angle?.to_radians()))
}

fn matrix(item: &Item) -> Read<DAffine3> {
    let expected = "16 numbers, row by row, the last row 0, 0, 0, 1";
    let numbers = super::all(&item.array(expected)?, Item::number)?;
    let rows: &[f64; 16] = numbers.as_slice().try_into().map_err(|_| item.expected(expected))?;
    if rows[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err(item.fail(format!("the last row is {:?}; expected {expected}", &rows[12..])));
    }
    let matrix = DAffine3::from_mat4(DMat4::from_cols_array(rows).transpose());
    // Singular matrices have a determinant of a few roundings of the product of their columns' lengths.
    const ROUNDINGS: f64 = 64.0 * f64::EPSILON;
    let columns = matrix.matrix3.x_axis.length() * matrix.matrix3.y_axis.length() * matrix.matrix3.z_axis.length();
    let flat = matrix.matrix3.determinant().abs() <= ROUNDINGS * columns;
    if flat { Err(item.fail(NOT_INVERTIBLE)) } else { Ok(matrix) }
}

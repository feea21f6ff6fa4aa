//! Wavefront OBJ files: vertices, texture coordinates, normals and faces; the rest is skipped.

use super::Mesh;
use super::mesh::{MAX_TRIANGLES, Parts};
use crate::math::{DVec2, DVec3, Vec3};
use crate::{Error, Result};
use glam::Vec2;
use std::collections::HashMap;
use std::fs;
use std::path::Path;

/// Larger files are refused.
const MAX_BYTES: u64 = 16 << 30;
/// Polygons that are not convex are cut in quadratic time: those with more corners are refused.
const MAX_CONCAVE: usize = 5000;
/// In a corner: the face does not say.
const ABSENT: u32 = u32::MAX;

/// The indices of position, texture coordinates and normal.
type Corner = [u32; 3];

impl Mesh {
    /// The faces of a Wavefront OBJ file as one mesh; materials, groups, lines and points are skipped.
    /// Polygons are cut into triangles, concave ones by their ears. With `smooth` the shading normals
    /// are the file's or, where it has none, the mean around the vertex, weighted by area.
    ///
    /// # Errors
    /// [`Error::Asset`], with the line where there is one, when the file cannot be read, is not text,
    /// or has a malformed number, an index out of range, or no face with an area; [`Error::Limit`]
    /// when it is too large.
    pub fn load(path: &Path, smooth: bool) -> Result<Mesh> {
        let found = fs::metadata(path).map_err(|e| Error::asset(path, e))?;
        if !found.is_file() {
            return Err(Error::asset(path, "not a file: expected a Wavefront OBJ file"));
        }
        if found.len() > MAX_BYTES {
            let message = format!("{}: {} bytes: at most {MAX_BYTES} can be read", path.display(), found.len());
            return Err(Error::Limit(message));
        }
        let bytes = fs::read(path).map_err(|e| Error::asset(path, e))?;
        let text = String::from_utf8(bytes).map_err(|e| {
            let line = 1 + e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|&&b| b == b'\n').count();
            Error::asset(path, format!("line {line}: not UTF-8 text: expected a Wavefront OBJ file"))
        })?;
        let parts = parse(&text).map_err(|(line, message)| Error::asset(path, format!("line {line}: {message}")))?;
        if parts.triangles.is_empty() {
            return Err(Error::asset(path, "no faces: expected at least one line `f` with three corners or more"));
        }
        Mesh::from_parts(parts, smooth).map_err(|e| match e {
            Error::Scene(message) => Error::asset(path, message),
            Error::Limit(message) => Error::Limit(format!("{}: {message}", path.display())),
            other => other,
        })
    }
}

/// A line number and what is wrong there.
type Fault = (usize, String);

fn parse(text: &str) -> Result<Parts, Fault> {
    let (mut positions, mut uvs, mut normals) = (Vec::new(), Vec::new(), Vec::new());
    let mut corners: Vec<Corner> = Vec::new();
    // The line of each face and where its corners end.
    let mut faces: Vec<(usize, usize)> = Vec::new();
    let mut lines = text.lines().enumerate();
    let mut joined = String::new();
    while let Some((i, line)) = lines.next() {
        let number = i + 1;
        // ---- a backslash at the end continues the line
        let mut statement = line;
        if line.ends_with('\\') {
            joined.clear();
            joined.push_str(line);
            while joined.ends_with('\\') {
                joined.pop();
                joined.push(' ');
                match lines.next() {
                    Some((_, next)) => joined.push_str(next),
                    None => break,
                }
            }
            statement = &joined;
        }
        let statement = statement.split('#').next().unwrap_or_default();
        let mut words = statement.split_whitespace();
        let fault = |message: String| (number, message);
        match words.next() {
            Some("v") => positions.push(Vec3::from_array(numbers(&mut words, "v", 3).map_err(fault)?)),
            Some("vn") => normals.push(Vec3::from_array(numbers(&mut words, "vn", 3).map_err(fault)?)),
            Some("vt") => uvs.push(Vec2::from_array(numbers(&mut words, "vt", 1).map_err(fault)?)),
            Some("f") => {
                let counts = [positions.len(), uvs.len(), normals.len()];
                let start = corners.len();
                for word in words {
                    corners.push(corner(word, counts).map_err(fault)?);
                }
                if corners.len() - start < 3 {
                    return Err(fault("a face with fewer than three corners".into()));
                }
                faces.push((number, corners.len()));
            }
            _ => {}
        }
    }
    // ---- faces may name what comes later in the file
    let names = [("vertex", positions.len()), ("texture coordinate", uvs.len()), ("normal", normals.len())];
    let mut start = 0;
    let mut index = Index::default();
    let (mut triangles, mut cut) = (Vec::new(), Vec::new());
    for &(line, end) in &faces {
        let face = &corners[start..end];
        start = end;
        for corner in face {
            for (&index, (name, count)) in corner.iter().zip(names) {
                let absent = index == ABSENT && name != "vertex";
                if !absent && index as usize >= count {
                    let message = format!("a face names {name} {}, but the file has {count}", u64::from(index) + 1);
                    return Err((line, message));
                }
            }
        }
        let outline: Vec<DVec3> = face.iter().map(|c| positions[c[0] as usize].as_dvec3()).collect();
        cut.clear();
        triangulate(&outline, &mut cut).map_err(|message| (line, message))?;
        triangles.extend(cut.iter().map(|t| t.map(|i| index.vertex(face[i]))));
        if triangles.len() > MAX_TRIANGLES {
            return Err((line, format!("more than {MAX_TRIANGLES} triangles")));
        }
    }
    // ---- one vertex for each combination of indices
    let has_uvs = !uvs.is_empty() && index.vertices.iter().any(|c| c[1] != ABSENT);
    let position = |c: &Corner| positions[c[0] as usize];
    let uv = |c: &Corner| uvs.get(c[1] as usize).copied().unwrap_or_default();
    let normal = |c: &Corner| normals.get(c[2] as usize).copied().unwrap_or_default();
    Ok(Parts {
        positions: index.vertices.iter().map(position).collect(),
        normals: index.vertices.iter().map(normal).collect(),
        uvs: if has_uvs { index.vertices.iter().map(uv).collect() } else { Vec::new() },
        triangles,
    })
}

/// Combinations of indices that occur.
#[derive(Default)]
struct Index {
    known: HashMap<Corner, u32>,
    vertices: Vec<Corner>,
}

impl Index {
    fn vertex(&mut self, corner: Corner) -> u32 {
        *self.known.entry(corner).or_insert_with(|| {
            self.vertices.push(corner);
            self.vertices.len() as u32 - 1
        })
    }
}

/// The first `N` numbers of a statement, of which `required` must be there.
fn numbers<'a, const N: usize>(
    words: &mut impl Iterator<Item = &'a str>,
    key: &str,
    required: usize,
) -> Result<[f32; N], String> {
    let mut values = [0f32; N];
    for (i, value) in values.iter_mut().enumerate() {
        match words.next() {
            Some(word) => {
                *value = word.parse().map_err(|_| format!("`{word}` in `{key}`: expected a number"))?;
                if !value.is_finite() {
                    return Err(format!("`{word}` in `{key}`: expected a finite number"));
                }
            }
            None if i < required => return Err(format!("`{key}` with {i} numbers: expected {required}")),
            None => break,
        }
    }
    Ok(values)
}

/// `v`, `v/vt`, `v//vn` or `v/vt/vn`, from 1, or negative to count back from the latest.
fn corner(word: &str, counts: [usize; 3]) -> Result<Corner, String> {
    let mut corner = [ABSENT; 3];
    let mut fields = word.split('/');
    for (k, count) in counts.into_iter().enumerate() {
        let Some(field) = fields.next() else { break };
        if field.is_empty() && k > 0 {
            continue;
        }
        let wrong = || format!("`{word}` in a face: expected v, v/vt, v//vn or v/vt/vn with indices from 1 or below 0");
        let value: i64 = field.parse().map_err(|_| wrong())?;
        let index = if value > 0 { Some(value - 1) } else { value.checked_add(count as i64).filter(|_| value < 0) };
        corner[k] = index.and_then(|i| u32::try_from(i).ok()).filter(|&i| i != ABSENT).ok_or_else(wrong)?;
    }
    if fields.next().is_some() || corner[0] == ABSENT {
        return Err(format!("`{word}` in a face: expected v, v/vt, v//vn or v/vt/vn"));
    }
    Ok(corner)
}

/// Cuts a polygon into triangles: a fan if it is convex, otherwise ears (Eberly 2008, "Triangulation by
/// ear clipping") in the plane of its mean normal (Newell's).
fn triangulate(outline: &[DVec3], out: &mut Vec<[usize; 3]>) -> Result<(), String> {
    let n = outline.len();
    if n == 3 {
        out.push([0, 1, 2]);
        return Ok(());
    }
    // ---- onto the plane, seen so that the polygon runs counter-clockwise
    let origin = outline[0];
    let normal: DVec3 = (0..n).map(|i| (outline[i] - origin).cross(outline[(i + 1) % n] - origin)).sum();
    let axis = normal.abs();
    let flat: Vec<DVec2> = outline
        .iter()
        .map(|p| {
            if axis.x >= axis.y && axis.x >= axis.z {
                DVec2::new(p.y, p.z * normal.x.signum())
            } else if axis.y >= axis.z {
                DVec2::new(p.z, p.x * normal.y.signum())
            } else {
                DVec2::new(p.x, p.y * normal.z.signum())
            }
        })
        .collect();
    let turn = |a: usize, b: usize, c: usize| (flat[b] - flat[a]).perp_dot(flat[c] - flat[b]);
    if (0..n).all(|i| turn(i, (i + 1) % n, (i + 2) % n) >= 0.0) {
        out.extend((1..n - 1).map(|i| [0, i, i + 1]));
        return Ok(());
    }
    if n > MAX_CONCAVE {
        return Err(format!("a concave face with {n} corners: at most {MAX_CONCAVE} can be cut; use smaller faces"));
    }
    // ---- ears: convex corners whose triangle contains no other corner
    let mut rest: Vec<usize> = (0..n).collect();
    while rest.len() > 3 {
        let m = rest.len();
        let is_ear = |i: usize| {
            let (a, b, c) = (rest[(i + m - 1) % m], rest[i], rest[(i + 1) % m]);
            let blocks = |&p: &usize| {
                let apart = flat[p] != flat[a] && flat[p] != flat[b] && flat[p] != flat[c];
                apart && turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0
            };
            turn(a, b, c) > 0.0 && !rest.iter().any(blocks)
        };
        // A polygon that crosses itself may have no ear; any corner is then as good as another.
        let ear = (0..m).find(|&i| is_ear(i)).unwrap_or(0);
        out.push([rest[(ear + m - 1) % m], rest[ear], rest[(ear + 1) % m]]);
        rest.remove(ear);
    }
    out.push([rest[0], rest[1], rest[2]]);
    Ok(())
}

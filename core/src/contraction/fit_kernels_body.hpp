// No header of its own: fit_kernels.cpp includes it once for each instruction set, in a namespace
// of its own. Lanes never mix, so the width of the machine's vectors changes nothing.

#include "base/float_lanes_body.hpp"

constexpr std::size_t kRows = FitLanes::kRows;

struct Vector {
    Float8 x, y, z;

    Float8 dot(const Vector& o) const noexcept { return x * o.x + y * o.y + z * o.z; }
    void add(Float8 factor, const Vector& o) noexcept {
        x += factor * o.x;
        y += factor * o.y;
        z += factor * o.z;
    }
};

[[gnu::always_inline]] inline Vector vector_of(const FitLanes::Row& row) noexcept {
    return {load(row.x), load(row.y), load(row.z)};
}

[[gnu::always_inline]] inline void write(const Vector& v, FitLanes::Row& row) noexcept {
    store(v.x, row.x);
    store(v.y, row.y);
    store(v.z, row.z);
}

/// The neighbours as they are seen from the place, in units of h.
struct Seen {
    Vector at[kRows];
    Float8 weight[kRows];
};

inline void look(const FitLanes& lanes, Seen& seen) noexcept {
    const Float8 per_h = load(lanes.per_h);
    const Float8 px = load(lanes.place.x), py = load(lanes.place.y), pz = load(lanes.place.z);
    for (std::size_t j = 0; j < kRows; ++j) {
        const FitLanes::Row& row = lanes.around[j];
        const Vector d{(load(row.x) - px) * per_h, (load(row.y) - py) * per_h,
                       (load(row.z) - pz) * per_h};
        seen.at[j] = d;
        seen.weight[j] = gaussian(d.dot(d));
    }
}

/// The plane n . x = t of weighted least squares, and two directions along it.
struct Plane {
    Vector n, e1, e2;
    Float8 t;
    Int8 stands;  ///< false where there is none
};

inline Plane plane_of(const Seen& seen) noexcept {
    Float8 w{}, x{}, y{}, z{}, xx{}, xy{}, xz{}, yy{}, yz{}, zz{};
    for (std::size_t j = 0; j < kRows; ++j) {
        const Vector& d = seen.at[j];
        const Float8 wx = seen.weight[j] * d.x, wy = seen.weight[j] * d.y,
                     wz = seen.weight[j] * d.z;
        w += seen.weight[j];
        x += wx;
        y += wy;
        z += wz;
        xx += wx * d.x;
        xy += wx * d.y;
        xz += wx * d.z;
        yy += wy * d.y;
        yz += wy * d.z;
        zz += wz * d.z;
    }
    const Double8 tiny = Double8{} + 1e-60;
    const Double8 total = wide(w), by = 1.0 / (total > tiny ? total : tiny);
    const Double8 mx = wide(x) * by, my = wide(y) * by, mz = wide(z) * by;
    Double8 sxx = wide(xx) * by - mx * mx, sxy = wide(xy) * by - mx * my,
            sxz = wide(xz) * by - mx * mz, syy = wide(yy) * by - my * my,
            syz = wide(yz) * by - my * mz, szz = wide(zz) * by - mz * mz;
    const Double8 trace = sxx + syy + szz;
    const Double8 norm = 1.0 / (trace > tiny ? trace : tiny);
    sxx *= norm;
    sxy *= norm;
    sxz *= norm;
    syy *= norm;
    syz *= norm;
    szz *= norm;
    const Double8 minor_x = syy * szz - syz * syz, minor_y = sxx * szz - sxz * sxz,
                  minor_z = sxx * syy - sxy * sxy;
    const Double8 c1 = minor_x + minor_y + minor_z;
    const Double8 c0 =
        sxx * minor_x - sxy * (sxy * szz - syz * sxz) + sxz * (sxy * syz - syy * sxz);
    const Double8 least = smallest_eigenvalue(c1, c0 > 0.0 ? c0 : Double8{});

    // The rows of the matrix less its eigenvalue span what is orthogonal to the eigenvector.
    const Double8 rows[3][3] = {
        {sxx - least, sxy, sxz}, {sxy, syy - least, syz}, {sxz, syz, szz - least}};
    Double8 n[3] = {}, length_sq = {};
    for (std::size_t row = 0; row < 3; ++row) {
        const Double8 *a = rows[row], *b = rows[(row + 1) % 3];
        const Double8 c[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                              a[0] * b[1] - a[1] * b[0]};
        const Double8 sq = c[0] * c[0] + c[1] * c[1] + c[2] * c[2];
        const Long8 longer = sq > length_sq;
        for (std::size_t axis = 0; axis < 3; ++axis) n[axis] = longer ? c[axis] : n[axis];
        length_sq = longer ? sq : length_sq;
    }
    constexpr double kParallel = 1e-20;  // of the rows, squared
    constexpr double kLine = 1e-6;       // across it, squared, as part of the whole extent
    const Long8 flat = (length_sq > kParallel) & (c1 > kLine);
    const Double8 one = Double8{} + 1.0;
    const Double8 unit = 1.0 / square_root(flat ? length_sq : one);
    for (Double8& axis : n) axis = flat ? axis * unit : Double8{};
    n[2] = flat ? n[2] : one;

    // Duff et al. 2017: directions across n.
    const Double8 sign = n[2] < 0.0 ? -one : one;
    const Double8 a = -1.0 / (sign + n[2]), b = n[0] * n[1] * a;
    Plane plane;
    plane.n = {narrow(n[0]), narrow(n[1]), narrow(n[2])};
    plane.e1 = {narrow(1.0 + sign * n[0] * n[0] * a), narrow(sign * b), narrow(-sign * n[0])};
    plane.e2 = {narrow(b), narrow(sign + n[1] * n[1] * a), narrow(-n[1])};
    plane.t = narrow(n[0] * mx + n[1] * my + n[2] * mz);
    plane.stands = narrow(flat);
    return plane;
}

constexpr std::size_t kTerms = 6;  // 1, u, v, uu, uv, vv; the first three are the linear basis

/// The weighted least squares problem of a polynomial over the plane: the lower triangle of its
/// matrix, factored; of a term that those before it make up, the pivot's inverse is 0.
struct Polynomial {
    Float8 matrix[kTerms][kTerms], inverse[kTerms];

    /// Solves for the first terms, in place.
    void solve(Float8* right, std::size_t terms) const noexcept {
        for (std::size_t i = 0; i < terms; ++i)
            for (std::size_t k = 0; k < i; ++k) right[i] -= matrix[i][k] * right[k];
        for (std::size_t i = terms; i-- > 0;) {
            right[i] *= inverse[i];
            for (std::size_t k = i + 1; k < terms; ++k) right[i] -= matrix[k][i] * right[k];
        }
    }

    /// Of the matrix to the factors L D L^T.
    void factorise() noexcept {
        constexpr float kDependent = 1e-5F;
        for (std::size_t j = 0; j < kTerms; ++j) {
            Float8 pivot = matrix[j][j];
            for (std::size_t k = 0; k < j; ++k) {
                const Float8 scaled = matrix[j][k];  // of L D, as are the rows below
                matrix[j][k] *= inverse[k];
                pivot -= scaled * matrix[j][k];
            }
            const Int8 own = pivot > kDependent * matrix[j][j];
            inverse[j] = own ? 1.0F / (own ? pivot : Float8{} + 1.0F) : Float8{};
            for (std::size_t i = j + 1; i < kTerms; ++i)
                for (std::size_t k = 0; k < j; ++k) matrix[i][j] -= matrix[i][k] * matrix[j][k];
        }
    }
};

/// The neighbours over the plane.
struct Over {
    Float8 u[kRows], v[kRows], height[kRows];
};

/// @param right  the right side. @param highest  the largest height.
inline void set_up(const Seen& seen, const Plane& plane, Over& over, Polynomial& polynomial,
                   Float8* right, Float8& highest) noexcept {
    // Sums of w u^i v^j, named by i and j.
    Float8 s00{}, s10{}, s01{}, s20{}, s11{}, s02{}, s30{}, s21{}, s12{}, s03{}, s40{}, s31{},
        s22{}, s13{}, s04{};
    Float8 r[kTerms] = {};
    highest = Float8{};
    for (std::size_t j = 0; j < kRows; ++j) {
        const Vector& d = seen.at[j];
        const Float8 w = seen.weight[j];
        const Float8 u = plane.e1.dot(d), v = plane.e2.dot(d), height = plane.n.dot(d) - plane.t;
        over.u[j] = u;
        over.v[j] = v;
        over.height[j] = height;
        const Float8 size = height < 0.0F ? -height : height;
        highest = size > highest ? size : highest;
        const Float8 wu = w * u, wv = w * v, uu = u * u, uv = u * v, vv = v * v;
        const Float8 wuu = w * uu, wuv = w * uv, wvv = w * vv;
        s00 += w;
        s10 += wu;
        s01 += wv;
        s20 += wuu;
        s11 += wuv;
        s02 += wvv;
        s30 += wuu * u;
        s21 += wuu * v;
        s12 += wvv * u;
        s03 += wvv * v;
        s40 += wuu * uu;
        s31 += wuu * uv;
        s22 += wuu * vv;
        s13 += wvv * uv;
        s04 += wvv * vv;
        r[0] += w * height;
        r[1] += wu * height;
        r[2] += wv * height;
        r[3] += wuu * height;
        r[4] += wuv * height;
        r[5] += wvv * height;
    }
    const Float8 lower[] = {s00, s10, s20, s01, s11, s02, s20, s30, s21, s40, s11,
                            s21, s12, s31, s22, s02, s12, s03, s22, s13, s04};
    const Float8* entry = lower;
    for (std::size_t i = 0; i < kTerms; ++i)
        for (std::size_t k = 0; k <= i; ++k) polynomial.matrix[i][k] = *entry++;
    for (std::size_t i = 0; i < kTerms; ++i) right[i] = r[i];
}

/// The gradients of the polynomials' heights at the origin, and these heights.
/// @param b  how the right sides change the heights: of the linear one, then of the quadratic one.
/// @param c  the polynomials' coefficients.
inline void differentiate(const Seen& seen, const Plane& plane, const Over& over,
                          const Float8 (*b)[kTerms], const Float8 (*c)[kTerms],
                          FitAnswers& answers) noexcept {
    const Float8 *lb = b[0], *lc = c[0], *qb = b[1], *qc = c[1];
    for (std::size_t j = 0; j < kRows; ++j) {
        const Vector& d = seen.at[j];
        const Float8 u = over.u[j], v = over.v[j], w = seen.weight[j], height = over.height[j];
        const auto gradient = [&](Float8 at_b, Float8 at_c, Float8 bu, Float8 bv, Float8 cu,
                                  Float8 cv, FitLanes::Row & row) __attribute__((always_inline)) {
            const Float8 share = w * at_b, residual = height - at_c, moved = w * residual;
            const Float8 along_u = moved * bu - share * cu, along_v = moved * bv - share * cv;
            const Float8 inward = -2.0F * share * residual;
            write({share * plane.n.x + along_u * plane.e1.x + along_v * plane.e2.x + inward * d.x,
                   share * plane.n.y + along_u * plane.e1.y + along_v * plane.e2.y + inward * d.y,
                   share * plane.n.z + along_u * plane.e1.z + along_v * plane.e2.z + inward * d.z},
                  row);
        };
        gradient(lb[0] + u * lb[1] + v * lb[2], lc[0] + u * lc[1] + v * lc[2], lb[1], lb[2], lc[1],
                 lc[2], answers.gradients[j].linear);
        const Float8 bu = qb[1] + u * qb[3] + v * qb[4], bv = qb[2] + v * qb[5];
        const Float8 cu = qc[1] + u * qc[3] + v * qc[4], cv = qc[2] + v * qc[5];
        gradient(qb[0] + u * bu + v * bv, qc[0] + u * cu + v * cv, bu + u * qb[3],
                 bv + u * qb[4] + v * qb[5], cu + u * qc[3], cv + u * qc[4] + v * qc[5],
                 answers.gradients[j].quadratic);
    }
}

void run(const FitLanes& lanes, FitAnswers& answers) noexcept {
    Seen seen;
    look(lanes, seen);
    const Plane plane = plane_of(seen);
    for (Float8& w : seen.weight) w = plane.stands ? w : Float8{};
    Over over;
    Polynomial polynomial;
    Float8 right[kTerms], highest;
    set_up(seen, plane, over, polynomial, right, highest);
    polynomial.factorise();
    Float8 b[2][kTerms] = {}, c[2][kTerms] = {};
    for (std::size_t basis = 0; basis < 2; ++basis) {
        const std::size_t terms = basis == 0 ? 3 : kTerms;
        b[basis][0] = Float8{} + 1.0F;
        for (std::size_t i = 0; i < terms; ++i) c[basis][i] = right[i];
        polynomial.solve(b[basis], terms);
        polynomial.solve(c[basis], terms);
    }
    // A quadratic one that overshoots gives way to the linear one.
    const Float8 top = c[1][0] < 0.0F ? -c[1][0] : c[1][0];
    const Int8 trusted = top <= highest;
    for (std::size_t i = 0; i < kTerms; ++i) {
        b[1][i] = trusted ? b[1][i] : b[0][i];
        c[1][i] = trusted ? c[1][i] : c[0][i];
    }
    differentiate(seen, plane, over, b, c, answers);
    const Float8 per_h = load(lanes.per_h);
    const Float8 h = 1.0F / (plane.stands ? per_h : Float8{} + 1.0F);
    store(plane.stands ? -h * (plane.t + c[0][0]) : Float8{}, answers.linear_distance);
    store(plane.stands ? -h * (plane.t + c[1][0]) : Float8{}, answers.quadratic_distance);
}

void layers(const FitLanes& lanes, Floats& layered) noexcept {
    constexpr float kWide = 0.25F;  // twice as wide as the surface's weights
    Seen seen;
    look(lanes, seen);
    for (std::size_t j = 0; j < kRows; ++j)
        seen.weight[j] = gaussian(kWide * seen.at[j].dot(seen.at[j]));
    const Plane plane = plane_of(seen);
    Float8 total{}, second{}, third{}, fourth{};
    for (std::size_t j = 0; j < kRows; ++j) {
        const Float8 height = plane.n.dot(seen.at[j]) - plane.t, square = height * height,
                     weighted = seen.weight[j] * square;
        total += seen.weight[j];
        second += weighted;
        third += weighted * height;
        fourth += weighted * square;
    }
    const Float8 m2 = second / total, m3 = third / total, m4 = fourth / total;
    const Int8 two = (m3 * m3 + m2 * m2 * m2 > kLayered * m4 * m2) &
                     (m4 < kMostKurtosis * m2 * m2) & plane.stands;
    store(two ? Float8{} + 1.0F : Float8{}, layered);
}

void want(const FitWishes& wishes, FitLanes::Row* wanted, FitLanes::Floats* squares) noexcept {
    const Float8 weight = load(wishes.quadratic_weight);
    const FitAnswers* const end = wishes.answers + wishes.count;
    for (std::size_t i = 0; i < kRows; ++i) {
        Vector sum{};
        Float8 square{};
        for (const FitAnswers* answer = wishes.answers; answer != end; ++answer) {
            const Vector l = vector_of(answer->gradients[i].linear),
                         q = vector_of(answer->gradients[i].quadratic);
            sum.add(load(answer->linear_distance), l);
            sum.add(weight * load(answer->quadratic_distance), q);
            square += l.dot(l) + weight * q.dot(q);
        }
        write(sum, wanted[i]);
        store(square, squares[i]);
    }
}

void look_along(const FitWishes& wishes, const FitLanes::Row* direction,
                FitLanes::Row* image) noexcept {
    const Float8 weight = load(wishes.quadratic_weight);
    const FitAnswers* const end = wishes.answers + wishes.count;
    Vector along[kRows], sums[kRows] = {};
    for (std::size_t i = 0; i < kRows; ++i) along[i] = vector_of(direction[i]);
    for (const FitAnswers* answer = wishes.answers; answer != end; ++answer) {
        Float8 linear{}, quadratic{};
        for (std::size_t i = 0; i < kRows; ++i) {
            linear += along[i].dot(vector_of(answer->gradients[i].linear));
            quadratic += along[i].dot(vector_of(answer->gradients[i].quadratic));
        }
        quadratic *= weight;
        for (std::size_t i = 0; i < kRows; ++i) {
            sums[i].add(linear, vector_of(answer->gradients[i].linear));
            sums[i].add(quadratic, vector_of(answer->gradients[i].quadratic));
        }
    }
    for (std::size_t i = 0; i < kRows; ++i) write(sums[i], image[i]);
}

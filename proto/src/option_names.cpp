#include "stipple/proto/option_names.hpp"

#include "names.hpp"

#include <array>

namespace stipple::proto {

namespace {

constexpr std::array kReductions = {
    Named<Reduction>{Reduction::Mean, "mean"}, Named<Reduction>{Reduction::Nearest, "nearest"},
    Named<Reduction>{Reduction::Min, "min"},   Named<Reduction>{Reduction::Max, "max"},
    Named<Reduction>{Reduction::Mode, "mode"},
};
constexpr std::array kRepresentatives = {
    Named<Representative>{Representative::Surface, "surface"},
    Named<Representative>{Representative::Centroid, "centroid"},
    Named<Representative>{Representative::Nearest, "nearest"},
};
constexpr std::array kPlacements = {
    Named<Placement>{Placement::Optimal, "optimal"},
    Named<Placement>{Placement::EndPoint, "end-point"},
};
constexpr std::array kSplats = {
    Named<SplatAttributes>{SplatAttributes::None, "none"},
    Named<SplatAttributes>{SplatAttributes::Radius, "radius"},
    Named<SplatAttributes>{SplatAttributes::Normal, "normal"},
    Named<SplatAttributes>{SplatAttributes::Ellipse, "ellipse"},
};
constexpr std::array kSigns = {
    Named<NormalSigns>{NormalSigns::SpanningTree, "mst"},
    Named<NormalSigns>{NormalSigns::Viewpoint, "viewpoint"},
    Named<NormalSigns>{NormalSigns::Any, "none"},
};
constexpr std::array kCodings = {
    Named<DracoCoding>{DracoCoding::Auto, "auto"},
    Named<DracoCoding>{DracoCoding::Sequential, "sequential"},
    Named<DracoCoding>{DracoCoding::KdTree, "kd-tree"},
};

}  // namespace

std::string_view to_string(Reduction reduction) noexcept {
    return name_of(kReductions, reduction);
}
std::string_view to_string(Representative representative) noexcept {
    return name_of(kRepresentatives, representative);
}
std::string_view to_string(Placement placement) noexcept {
    return name_of(kPlacements, placement);
}
std::string_view to_string(SplatAttributes splats) noexcept {
    return name_of(kSplats, splats);
}
std::string_view to_string(NormalSigns signs) noexcept {
    return name_of(kSigns, signs);
}
std::string_view to_string(DracoCoding coding) noexcept {
    return name_of(kCodings, coding);
}

Reduction reduction_from_name(std::string_view name) {
    return by_name(kReductions, name);
}
Representative representative_from_name(std::string_view name) {
    return by_name(kRepresentatives, name);
}
Placement placement_from_name(std::string_view name) {
    return by_name(kPlacements, name);
}
SplatAttributes splats_from_name(std::string_view name) {
    return by_name(kSplats, name);
}
NormalSigns normal_signs_from_name(std::string_view name) {
    return by_name(kSigns, name);
}
DracoCoding draco_coding_from_name(std::string_view name) {
    return by_name(kCodings, name);
}

}  // namespace stipple::proto

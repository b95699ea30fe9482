// Vector with cheap copies: a copy shares its elements with the original until one of the two is
// edited. For the long lists inside a value that changes more often than they do.
#pragma once

#include <cstddef>
#include <initializer_list>
#include <utility>
#include <vector>

#include "server/map/cow_ptr.h"

namespace cairn {

// Threads as with CowPtr: copies may live on different ones, one object is for one at a time.
template <typename T>
class CowVector {
 public:
  CowVector() = default;
  CowVector(std::vector<T> elements)  // NOLINT(google-explicit-constructor): it is one
      : elements_(CowPtr<std::vector<T>>::make(std::move(elements))) {}
  CowVector(std::initializer_list<T> elements) : CowVector(std::vector<T>(elements)) {}

  const std::vector<T>& get() const {
    static const std::vector<T> none;
    return elements_ ? *elements_ : none;
  }
  operator const std::vector<T>&() const { return get(); }  // NOLINT(google-explicit-constructor)
  // Copied first where others share it. Valid until this object is copied or destroyed.
  std::vector<T>& edit() {
    if (!elements_) elements_ = CowPtr<std::vector<T>>::make();
    return elements_.edit();
  }

  std::size_t size() const { return get().size(); }
  bool empty() const { return get().empty(); }
  const T& operator[](std::size_t i) const { return get()[i]; }
  const T& front() const { return get().front(); }
  auto begin() const { return get().begin(); }
  auto end() const { return get().end(); }
  friend bool operator==(const CowVector& a, const CowVector& b) { return a.get() == b.get(); }

 private:
  CowPtr<std::vector<T>> elements_;
};

}  // namespace cairn

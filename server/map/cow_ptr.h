// Shared pointer for copy on write: owners share one value until one of them changes it.
//
// Why not std::shared_ptr: its use_count() is a relaxed load, so seeing 1 does not order the
// owner's next write after the last reads of an owner on another thread that has just let go.
// unique() here is an acquire load that pairs with that owner's release; ThreadSanitizer
// understands it too. Besides, value and count are one allocation and the pointer is one word.
#pragma once

#include <atomic>
#include <cstdint>
#include <utility>

namespace cairn {

// Copies may live on different threads; one object is for one thread at a time.
template <typename T>
class CowPtr {
 public:
  CowPtr() = default;
  template <typename... Args>
  static CowPtr make(Args&&... args) {
    CowPtr p;
    p.cell_ = new Cell{{1}, T(std::forward<Args>(args)...)};
    return p;
  }
  CowPtr(const CowPtr& other) noexcept : cell_(other.cell_) {
    if (cell_) cell_->owners.fetch_add(1, std::memory_order_relaxed);
  }
  CowPtr(CowPtr&& other) noexcept : cell_(std::exchange(other.cell_, nullptr)) {}
  CowPtr& operator=(CowPtr other) noexcept {
    std::swap(cell_, other.cell_);
    return *this;
  }
  ~CowPtr() {
    if (cell_ && cell_->owners.fetch_sub(1, std::memory_order_acq_rel) == 1) delete cell_;
  }

  explicit operator bool() const { return cell_ != nullptr; }
  const T& operator*() const { return cell_->value; }
  const T* operator->() const { return &cell_->value; }
  const T* get() const { return cell_ ? &cell_->value : nullptr; }

  // The value to change; copied first where others share it. Must not be null.
  T& edit() {
    if (cell_->owners.load(std::memory_order_acquire) != 1) *this = make(cell_->value);
    return cell_->value;
  }

 private:
  struct Cell {
    std::atomic<std::uint32_t> owners;
    T value;
  };
  Cell* cell_ = nullptr;
};

}  // namespace cairn

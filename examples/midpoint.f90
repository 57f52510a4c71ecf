! The stochastic midpoint rule in Fortran 2003, with the conversation of client.h:
!
!     cc -O2 -c -x c examples/client.h -o client.o
!     gfortran -O2 -o midpoint examples/midpoint.f90 client.o
!     sepv verify --exec ./midpoint
!
! y1 = y + D f((y + y1)/2), f = B grad H, with the random step D = h + sum_j c_j dW_j: equation (3.4) of
! D. Cohen and G. Dujardin, Energy-preserving integrators for stochastic Poisson systems (2014).
module midpoint
  use, intrinsic :: iso_c_binding, only: c_ptr, c_int, c_double, c_char, c_null_char
  implicit none
  character(len=*), parameter :: words = '"scheme":"midpoint-fortran","mean_square_order":1,"polynomial":true,' // &
    '"claims":["contract","identity","casimir","midpoint","symmetry"],"max_steps":256,' // &
    '"problems":["harmonic-oscillator","rigid-body","pendulum"]' // c_null_char
  integer, private :: k
  character(kind=c_char), bind(c, name="hello") :: hello(len(words)) = [(words(k:k), k = 1, len(words))]

  interface
    subroutine field(problem, y, f) bind(c)  ! f = B(y) grad H(y)
      import :: c_ptr, c_double
      type(c_ptr), value :: problem
      real(c_double), intent(in) :: y(*)
      real(c_double), intent(out) :: f(*)
    end subroutine
  end interface

contains

  subroutine increment(problem, d, y, z, delta, r) bind(c)
    type(c_ptr), value :: problem
    integer(c_int), value :: d
    real(c_double), value :: delta
    real(c_double), intent(in) :: y(d), z(d)
    real(c_double), intent(out) :: r(d)
    call field(problem, y + 0.5_c_double * z, r)
    r = delta * r
  end subroutine
end module

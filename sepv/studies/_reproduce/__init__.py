"""The numerical experiments of §4, figure by figure, with a verdict on every statement made about them."""

"""The paper's task on the cart-pole of the DeepMind control suite: balance at one place, then at another."""

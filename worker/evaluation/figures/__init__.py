"""The paper's figures, drawn from a report; each module draws one figure or a family of them."""

"""The cockpit: a page in the browser that shows a graph, and a stick to fly it with."""

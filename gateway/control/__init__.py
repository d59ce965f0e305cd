"""The control socket, where the other commands of this program ask a gateway at work.

- server       one JSON object a line; the verbs are the operations of `operator.operations`
- messages     what stands in these objects: questions and answers
- path         where the socket is
"""
